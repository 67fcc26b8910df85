"""Messages of somebody who holds no lease: junk and news, on every key that the daemon hears."""

import random
from typing import NamedTuple

from telerobot.config.load import Cell
from telerobot.protocols import topics as t
from telerobot.protocols.codec import encode
from telerobot.protocols.messages.messages import Message
from telerobot.protocols.topics import Flow, Topic

from .news import News
from .payloads import junk, mutated
from .values import Values

KEPT = (t.KEEPALIVE, t.LEASE, t.RELEASE, t.PROTECTIVE_STOP)
"""The holder does not give his lease away by chance, and who may stop the arm does not."""
ASKED = tuple(topic for topic in (*t.COMMANDS, *t.REQUESTS) if topic not in KEPT[1:])


class Said(NamedTuple):
    """One message, as it goes out."""

    topic: Topic
    payload: bytes
    proof: bytes


class Stranger:
    """Draws messages for one cell from a seed."""

    def __init__(self, cell: Cell, seed: str) -> None:
        self.dice = random.Random(seed)
        config = cell.config
        words = (
            *config.mechanism.postures,
            *config.mechanism.payloads,
            *(o.name for o in config.obstacles),
            *(c.name for c in config.cameras),
        )
        self.values = Values(self.dice, words)
        self._news = News(cell, self.values)

    def draw(self, tick: int) -> Said:
        """Return a message that looks as if it were based on telemetry of a tick."""
        dice = self.dice
        topic = dice.choice(self._news.topics if dice.random() < 0.5 else ASKED)
        message = self._valid(topic, tick) if dice.random() < 0.7 else None
        payload = junk(self.values, topic) if message is None else encode(message)
        if message is not None and dice.random() < 0.3:
            payload = mutated(dice, payload)
        return Said(topic, payload, self._forged())

    def _valid(self, topic: Topic, tick: int) -> Message | None:
        if topic.flow is Flow.SENSOR:
            return self._news.of(topic, tick)
        given = {"seen_tick": tick} if topic.needs_proof else {}
        return self.values.message(topic.message, **given)

    def _forged(self) -> bytes:
        """Return what stands for a proof of the lease: nothing, noise, or nearly one."""
        dice = self.dice
        numbers = dice.randrange(3), dice.choice((0, 10**6, 2**63 - 1, 2**64 - 1))
        near = b"".join(n.to_bytes(8, "big") for n in numbers) + dice.randbytes(16)
        return dice.choice((b"", dice.randbytes(dice.choice((1, 32, 4096))), near))
