"""Floods a cell's daemon with junk: `python flooder.py ENDPOINT CELL KIND RATE SECONDS`.

Knows no secret. Prints how many messages it sent. Kinds: `random` bytes, `nested` MessagePack,
`forged` proofs and `wellformed` news and requests, on every key in turn; the same with `@KEY`, on
that key alone; `huge`, 100 MB at a time; `deaf`, a peer that asks, and reads no answer.

It takes longer where the machine is too slow for the rate: until a third of it all was sent.
"""

import itertools
import json
import os
import socket
import struct
import sys
import threading
import time

import msgpack
import zenoh

PUT = (
    "keepalive", "joystick", "position", "force", "jog", "posture", "path", "master_pose", "cancel",
)  # fmt: skip
ASK = (
    "lease", "release", "mode", "protective_clear", "protective_stop", "gain", "switch", "frame",
    "speed", "tare", "payload", "gripper", "store_view", "redundancy", "path", "clutch",
    "avoidance", "reflection",
)  # fmt: skip
LEAST = 1 / 3
"""Part of what rate and time ask for that is sent at least [1]."""
KEYS = (
    *(f"cmd/{key}" for key in PUT),
    *(f"sensor/{key}" for key in ("vision", "obstacle", "frame")),
    *(f"operator/{key}" for key in ASK),
)


def nested():
    maps = b"\x81\xa1k" * 400 + b"\xc0"
    arrays = b"\x81\xa4name" + b"\x91" * 1400 + b"\xc0"
    wide = b"\xde\x02\x00" + b"".join(b"\xa2" + b"%02x" % (i % 256) + b"\x90" for i in range(512))
    return itertools.cycle([maps, arrays, wide])


def contents(kind, key):
    """Yield payload and attachment."""
    if kind == "random":
        for n in itertools.count():
            yield os.urandom(20 + 37 * (n % 50)), os.urandom(32) if n % 2 else None
    elif kind == "nested":
        for payload in nested():
            yield payload, None
    elif kind == "forged":
        for n in itertools.count():
            payload = msgpack.packb({"v": 2, "seen_tick": n})
            yield payload, struct.pack(">QQ16s", 1 + n % 2, 10**5 + n, b"guess")
    elif kind == "wellformed":
        news = {"v": 2, "name": "junk", "tick": 1, "shape": "point", "xyz": [9, 9, 9]}
        frame = {"v": 2, "name": "base", "tick": 1, "xyz": [0, 0, 0], "rpy": [0, 0, 0]}
        lease = {"v": 2, "operator": "junk", "key": bytes(range(32))}
        clear = {"v": 2, "operator": "junk", "opens": bytes(32)}
        of = {"sensor/frame": frame, "operator/lease": lease, "operator/protective_clear": clear}
        payload = msgpack.packb(of.get(key, news))
        while True:
            yield payload, None
    elif kind == "huge":
        yield from itertools.repeat((bytes(100_000_000), None))
    else:
        raise SystemExit(f"no such kind: {kind}")


class Deaf:
    """A way to the daemon that carries everything there, and soon nothing back."""

    def __init__(self, endpoint):
        host, port = endpoint.removeprefix("tcp/").rsplit(":", 1)
        self._daemon = (host, int(port))
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        while True:
            peer, _ = self._listener.accept()
            daemon = socket.create_connection(self._daemon)
            for way in ((peer, daemon, None), (daemon, peer, 20_000)):
                threading.Thread(target=self._carry, args=way, daemon=True).start()

    def _carry(self, here, there, most):
        carried = 0
        try:
            while most is None or carried < most:
                content = here.recv(65536)
                if not content:
                    return
                there.sendall(content)
                carried += len(content)
            threading.Event().wait()  # reads no more
        except OSError:
            return


def open_session(endpoint):
    config = zenoh.Config()
    settings = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "transport/link/tx/lease": 60000,
    }
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config)


def main():
    endpoint, cell, kind, rate, seconds = sys.argv[1:]
    kind, _, only = kind.partition("@")
    keys = [only] if only else KEYS
    if kind == "deaf":
        endpoint, kind, keys = Deaf(endpoint).endpoint, "wellformed", KEYS[-len(ASK) :]
    if kind == "huge":
        keys = ["cmd/keepalive", "sensor/obstacle"]
    with open_session(endpoint) as session:
        session.declare_subscriber(f"telerobot/{cell}/tlm/**", zenoh.handlers.RingChannel(1))
        streams = {key: contents(kind, key) for key in keys}
        sent, start_s, waiting = 0, time.monotonic(), []
        for key in itertools.cycle(keys):
            payload, attached = next(streams[key])
            full = f"telerobot/{cell}/{key}"
            if key.startswith("operator/"):
                replies = zenoh.handlers.RingChannel(1)
                waiting.append(session.get(full, replies, payload=payload, attachment=attached))
                del waiting[:-1000]
            else:
                session.put(full, payload, attachment=attached)
            sent += 1
            if sent % 20 == 0 or kind == "huge":
                time.sleep(max(0.0, start_s + sent / float(rate) - time.monotonic()))
                over = time.monotonic() > start_s + float(seconds)
                if over and sent > LEAST * float(rate) * float(seconds):
                    break
        print(sent, flush=True)


if __name__ == "__main__":
    main()
