"""What a router lets through of all that somebody tries: observed on real sessions over loopback.

After each try follows a message on a key that everybody may use here. Messages of one session
arrive in order, so that what is not there when that one is, was refused and is not just late.
"""

import json
import queue
import socket

import zenoh
from telerobot.protocols.topics import OBSTACLE, TOPICS, VIDEO

CONTROL = "control"
PATIENCE_S = 20.0
"""A control message that has not come by then never will; a limit for failures only [s]."""


def free_endpoint(protocol="tls"):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"{protocol}/127.0.0.1:{probe.getsockname()[1]}"


NAMED = (*(OBSTACLE.by(name) for name in ("lidar", "judge-pa10", "vision")), VIDEO.by("wrist"))
"""Topics of three who tell of obstacles, or would like to, and of one camera."""


def all_keys(*cells):
    topics = [topic for topic in (*TOPICS, *NAMED) if topic.sender or not topic.by_camera]
    return [topic.full_key(cell) for cell in cells for topic in topics]


def with_control(config, *, out=True):
    """Return a router's configuration in which everybody may use the control key.

    Unless `out`, all that goes out is allowed to everybody: what is refused, is so on the way in.
    """
    control = json.loads(config.get_json("access_control"))
    every = [
        "put", "delete", "declare_subscriber", "query", "reply", "declare_queryable",
        "liveliness_token", "liveliness_query", "declare_liveliness_subscriber",
    ]  # fmt: skip
    rule = {"permission": "allow", "messages": every, "key_exprs": [CONTROL]}
    control["rules"].append({**rule, "id": "control", "flows": ["ingress", "egress"]})
    if not out:
        control["rules"].append({**rule, "id": "out", "flows": ["egress"], "key_exprs": ["**"]})
    control["subjects"].append({"id": "everybody"})
    control["policies"].append(
        {"rules": ["control", *([] if out else ["out"])], "subjects": ["everybody"]}
    )
    config.insert_json5("access_control", json.dumps(control))
    return config


class Try:
    """All that one session tries at a router, and what of it came through, by verb."""

    def __init__(self, router, session, keys):
        self.router, self.session, self._keys = router, session, keys
        self._seen = queue.Queue()
        # Indirect callbacks run in a thread each, and would be out of order.
        self._note = zenoh.handlers.Callback(self._take, indirect=False)

    def let_through(self):
        """Return the keys on which each verb had an effect."""
        router, session = self.router, self.session
        return {
            "put": self.passes(session, router, session.put),
            "delete": self.passes(session, router, lambda key, _: session.delete(key)),
            "hear": self.passes(router, session, router.put),
            "ask": self.reaches(session, router),
            "serve": self.reaches(router, session),
            "alive": self._alive(session, router),
            "see alive": self._alive(router, session),
        }

    def passes(self, sender, listener, send, sent=None, subscribed=None):
        """Return the keys of what a listener gets of what a sender sends on each key."""
        keys = (*(subscribed or self._keys), CONTROL)
        boxes = [listener.declare_subscriber(key, self._note) for key in keys]
        # What was declared before the control key is known when that one is.
        while not self._within(0.01):
            sender.put(CONTROL, b"meet")
        for key in sent or self._keys:
            send(key, b"x")
        sender.put(CONTROL, b"end")
        came = []
        while (note := self._seen.get(timeout=PATIENCE_S)) != (CONTROL, b"end"):
            came.append(note[0])
        for box in boxes:
            box.undeclare()
        return set(came) - {CONTROL}

    def reaches(self, asker, server, asked=None):
        """Return the keys of the queries that reach a server which offers to answer all."""

        def answer(query):
            self._seen.put((str(query.key_expr), None))
            query.reply(query.key_expr, b"x")

        box = zenoh.handlers.Callback(answer, indirect=False)
        offered = [server.declare_queryable(key, box) for key in (*self._keys, CONTROL)]
        self._until(lambda: asker.get(CONTROL, timeout=PATIENCE_S))
        for key in asked or self._keys:
            for _ in asker.get(key, timeout=PATIENCE_S):
                pass
        self._until(lambda: asker.get(CONTROL, timeout=PATIENCE_S))
        for each in offered:
            each.undeclare()
        return self._drained() - {CONTROL}

    def _alive(self, token_of, seen_by):
        """Return the keys of tokens that are seen by a subscriber to each key, or to a query."""
        tokens = [token_of.liveliness().declare_token(key) for key in (*self._keys, CONTROL)]
        alive = seen_by.liveliness()
        boxes = [alive.declare_subscriber(key, self._note, history=True) for key in self._keys]
        self._until(lambda: alive.get(CONTROL, timeout=PATIENCE_S))
        for key in self._keys:
            for reply in alive.get(key, timeout=PATIENCE_S):
                self._seen.put((str(reply.ok.key_expr), None))
        for each in (*tokens, *boxes):
            each.undeclare()
        return self._drained()

    def _take(self, sample):
        self._seen.put((str(sample.key_expr), sample.payload.to_bytes()))

    def _until(self, ask):
        """Ask again and again until somebody answers."""
        while not list(ask()):
            pass

    def _within(self, seconds):
        try:
            return self._seen.get(timeout=seconds)
        except queue.Empty:
            return None

    def _drained(self):
        seen = set()
        while not self._seen.empty():
            seen.add(self._seen.get()[0])
        return seen
