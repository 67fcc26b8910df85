"""Inbox of the network's messages: sorts the holder's out of all others, within a time budget.

Whatever arrives waits in rings, one for each topic, where newer messages push out older ones. Many
times a second the rings are emptied here. A message that is too long is thrown away before it is
copied, one that does not prove the lease before it is decoded. What is proven goes on to a mailbox
of its own, where nothing that lacks a proof can push it out.

What matters most comes first: the keepalive, protective stops and modes. For everything else there
is a budget of time in each tick; what is left over waits for the next one.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from itertools import chain
from typing import Any, Final

from ...protocols import topics as t
from ...protocols.codec import Reason
from ...protocols.messages.requests import Reply
from ...protocols.proof import Proof
from ..refusals import Refused, refusing_errors
from .admission import Admission, Instant
from .link import Answer, Link, RawMessage, Source, room

FIRST: Final = (t.KEEPALIVE, t.PROTECTIVE_STOP, t.MODE, t.RELEASE)
"""Sorted completely in every tick."""

REST: Final = tuple(x for x in (*t.COMMANDS, *t.REQUESTS) if x not in FIRST)
"""Sorted in turn, as far as the budget allows."""

HOLDERS: Final = frozenset(x.key for x in t.REQUESTS if x.needs_proof or x is t.PROTECTIVE_CLEAR)
ORDERS: Final = frozenset(x.key for x in t.COMMANDS if x is not t.KEEPALIVE)
"""Keys whose messages are taken as they were sent."""
LEASES, STOPS, KEEPALIVES = ({x.key} for x in (t.LEASE, t.PROTECTIVE_STOP, t.KEEPALIVE))

PART: Final = 0.1
"""Each of sorting, commands and sensors may take so much of a period [1]."""

ANSWERED: Final = 4
"""Refused requests that are answered in a tick; further ones find nobody [1]."""

PRESSED: Final = 16
"""More refusals than this between two looks are a flood, to be looked at more often [1]."""


@dataclass(frozen=True, slots=True)
class QueuedMessage:
    """A message that may be decoded: proven, or one that needs no proof."""

    topic: t.Topic
    payload: bytes
    proof: Proof | None
    answer: Answer | None = None
    sender: str = ""
    """Of a topic whose keys name their senders."""

    def reply(self, content: bytes | None) -> None:
        """Answer a request; with None it ends without an answer."""
        if self.answer is not None:
            self.answer(content)


@dataclass(slots=True)
class Refusal:
    """Messages of one topic that were refused; the first one's reason, how many, whom to answer."""

    topic: t.Topic
    refused: Refused
    count: int = 1
    answers: tuple[Answer, ...] = ()


class Inbox:
    """Empties the network's rings into one mailbox for each topic; `clock` measures the budget."""

    def __init__(
        self, link: Link, admission: Admission, clock: Callable[[], float], period_s: float
    ) -> None:
        self._link = link
        self._admission = admission
        self._clock = clock
        self._budget_s = PART * period_s
        self._boxes = {x.key: deque[QueuedMessage](maxlen=x.unread) for x in (*FIRST, *REST)}
        self._first, self._rest = ([(x, link.source(x)) for x in part] for part in (FIRST, REST))
        self._sensors = [(x, link.source(x), room(x)) for x in t.SENSORS]
        self._waiting: set[str] = set()
        """Keys of the mailboxes that hold something."""
        self._refusals: dict[str, Refusal] = {}
        self._answers_left = ANSWERED
        self.pressed = False
        """True while so much is refused that the rings should be emptied more often."""

    def sort(self, now: Instant) -> None:
        """Empty the rings of commands and requests, as far as the budget allows."""
        refused, crowded = 0, self._link.crowded
        for topic, source in self._first:
            if crowded and topic.flow is t.Flow.REQUEST:
                continue
            came = source.poll()
            if came is not None:
                refused += self._drain(topic, source, came, now, math.inf)
                crowded = self._link.crowded
        end_s = self._clock() + self._budget_s
        for i, (topic, source) in enumerate(self._rest):
            if crowded and topic.flow is t.Flow.REQUEST:
                continue
            came = source.poll()
            if came is not None:
                refused += self._drain(topic, source, came, now, end_s)
                crowded = self._link.crowded
                if self._clock() > end_s:
                    # The next ones come first, next time.
                    self._rest = self._rest[i + 1 :] + self._rest[: i + 1]
                    self.pressed = True
                    return
        self.pressed = refused > PRESSED

    def _drain(self, topic: t.Topic, source: Source, first: Any, now: Instant, end_s: float) -> int:
        """Sort what waits on a topic until a time; return how much of it was refused."""
        refused, came = 0, first
        for _ in range(room(topic)):
            raw = source.read(came)
            refused += raw is not None and not self._keep(topic, raw, now)
            if self._clock() > end_s or (topic.flow is t.Flow.REQUEST and self._link.crowded):
                break
            came = source.poll()
            if came is None:
                break
        return refused

    def refusals(self) -> list[Refusal]:
        """Return and forget what was refused since the last call, one entry for each topic."""
        taken = list(self._refusals.values())
        self._refusals.clear()
        self._answers_left = ANSWERED
        return taken

    def requests(self) -> Iterable[QueuedMessage]:
        """Return the requests: the holder's as they were sent, all others, and stops, which win."""
        if not self._waiting:
            return ()
        holders = self._in_order(self._take(HOLDERS))
        return chain(holders, self._take(LEASES), self._take(STOPS))

    def commands(self) -> Iterable[QueuedMessage]:
        """Return the holder's commands: keepalives, then the others as they were sent."""
        if not self._waiting:
            return ()
        return chain(self._take(KEEPALIVES), self._in_order(self._take(ORDERS)))

    def sensors(self) -> Iterator[QueuedMessage]:
        """Yield sensors' readings, one of each topic in turn, as far as the budget allows."""
        end_s = self._clock() + self._budget_s
        waiting = self._sensors
        while waiting:
            still = []
            for topic, source, left in waiting:
                came = source.poll()
                if came is None:
                    continue
                if left > 1:
                    still.append((topic, source, left - 1))
                raw = source.read(came)
                payload = None if raw is None else self._read(topic, raw)
                if raw is not None and payload is not None:
                    yield QueuedMessage(topic, payload, None, sender=raw.sender)
                if self._clock() > end_s:
                    self._sensors = [*self._sensors[1:], self._sensors[0]]
                    return
            waiting = still

    # --- one message -------------------------------------------------------------------------

    def _keep(self, topic: t.Topic, raw: RawMessage, now: Instant) -> bool:
        """Put a message into its mailbox, or refuse it; return whether it was kept."""
        payload = self._read(topic, raw)
        if payload is None:
            return False
        proof = None
        try:
            with refusing_errors:
                if topic.needs_proof or (topic is t.PROTECTIVE_CLEAR and len(raw.attached) > 0):
                    attached = bytes(raw.attached) if len(raw.attached) < 64 else b""
                    proof = self._admission.prove(topic, payload, attached, now)
                else:
                    self._admission.admit(topic, payload, None, now)  # can it be read at all?
        except Refused as refused:
            self._refuse(topic, refused, raw)
            return False
        box = self._boxes[topic.key]
        if len(box) == box.maxlen:
            box[0].reply(None)
        self._put(QueuedMessage(topic, payload, proof, raw.answer))
        return True

    def _read(self, topic: t.Topic, raw: RawMessage) -> bytes | None:
        """Return the payload, or refuse one that is too long, without copying it."""
        size = len(raw.payload)
        if size > topic.max_bytes:
            refused = Refused(Reason.TOO_LARGE, f"{size} bytes, at most {topic.max_bytes}")
            self._refuse(topic, refused, raw)
            return None
        return bytes(raw.payload)

    def _refuse(self, topic: t.Topic, refused: Refused, raw: RawMessage) -> None:
        entry = self._refusals.get(topic.key)
        if entry is None:
            entry = self._refusals[topic.key] = Refusal(topic, refused)
        else:
            entry.count += 1
        if raw.answer is None:
            return
        if self._answers_left > 0:
            self._answers_left -= 1
            entry.answers += (raw.answer,)
        else:
            raw.answer(None)

    # --- mailboxes ---------------------------------------------------------------------------

    def _put(self, queued: QueuedMessage) -> None:
        self._boxes[queued.topic.key].append(queued)
        self._waiting.add(queued.topic.key)

    def _take(self, keys: AbstractSet[str]) -> list[QueuedMessage]:
        """Return and forget what waits on some keys."""
        messages: list[QueuedMessage] = []
        for key in self._waiting & keys:
            self._waiting.remove(key)
            messages += self._boxes[key]
            self._boxes[key].clear()
        return messages

    def _in_order(self, messages: list[QueuedMessage]) -> Iterator[QueuedMessage]:
        """Yield letters by their sequence within the budget; put back what is beyond it.

        Topics arrive apart; what one operator said within a period is taken as it was said.
        """
        messages.sort(key=_seq)
        end_s = self._clock() + self._budget_s
        for i, queued in enumerate(messages):
            if i > 0 and self._clock() > end_s:
                for left in messages[i:]:
                    self._put(left)
                return
            yield queued


def refusal_reply(refused: Refused, now: Instant) -> Reply:
    """Return the reply that says why a request was refused."""
    return Reply(
        ok=False, reason=str(refused.reason)[:64], detail=refused.detail[:500], tick=now.tick
    )


def _seq(queued: QueuedMessage) -> int:
    return -1 if queued.proof is None else queued.proof.seq
