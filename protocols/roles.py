"""Who may do what on the network: each role's rights, from the one table of topics.

A *grant* is what a certificate says of its holder, as the path of a URI: `telerobot:pa10/operator`
is an operator of the cell pa10, `telerobot:pa10/sensor/vision` a sensor that may put on that key.
Nothing that is not granted is allowed.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Self

from .topics import SENSORS, TOPICS, Role, Topic

NAME: Final = r"[a-z][a-z0-9_]{0,31}"
"""Names of cells and of who is certified: parts of keys, of file names and of common names."""

SCHEME: Final = "telerobot:"
"""Scheme of the URIs in a certificate that are grants."""


SERVERS: Final = frozenset({Role.DAEMON, Role.ROUTER})
"""Roles that others dial."""


@dataclass(frozen=True, order=True)
class Grant:
    """A role in one cell; a sensor's names the key that it may put on."""

    cell: str
    role: Role
    topic: str = ""

    @classmethod
    def parse(cls, uri: str) -> Self | None:
        """Return what a URI grants; None if it is no grant of this protocol."""
        found = re.fullmatch(f"{SCHEME}({NAME})/([a-z_/]+)", uri)
        if found is None:
            return None
        cell, what = found.groups()
        if any(what == topic.key for topic in SENSORS):
            return cls(cell, Role.SENSOR, what)
        if what in {*Role} - {Role.SENSOR}:
            return cls(cell, Role(what))
        return None

    @property
    def uri(self) -> str:
        """The grant as it stands in a certificate."""
        return f"{SCHEME}{self.cell}/{self.topic or self.role}"


@dataclass(frozen=True)
class Rights:
    """The full keys that somebody may use, by what they do there."""

    puts: frozenset[str] = frozenset()
    hears: frozenset[str] = frozenset()
    asks: frozenset[str] = frozenset()
    answers: frozenset[str] = frozenset()

    def __or__(self, other: "Rights") -> "Rights":
        return Rights(
            self.puts | other.puts,
            self.hears | other.hears,
            self.asks | other.asks,
            self.answers | other.answers,
        )


def rights(grants: Iterable[Grant], holder: str = "") -> Rights:
    """Return what the holder of some grants may do, by its common name.

    On a topic `by_sender` it puts under its own name, or under none.
    """
    every = Rights()
    for grant in grants:
        every |= _rights(grant, sender_name(holder))
    return every


def sender_name(holder: str) -> str:
    """Return the name of a certificate's holder in keys: of `sensor-lidar` it is `lidar`."""
    return holder.removeprefix(f"{Role.SENSOR}-")


def _rights(grant: Grant, sender: str) -> Rights:
    granted = [t for t in TOPICS if t.flow.sender is grant.role and _granted(grant, t)]
    sent = granted + [t.by(sender) for t in granted if t.by_sender and sender]
    received = [t for t in TOPICS if grant.role in t.flow.receivers]
    return Rights(
        puts=frozenset(t.put_key(grant.cell) for t in sent if not t.flow.asks),
        hears=frozenset(t.heard_key(grant.cell) for t in received if not t.flow.asks),
        asks=frozenset(t.full_key(grant.cell) for t in sent if t.flow.asks),
        answers=frozenset(t.full_key(grant.cell) for t in received if t.flow.asks),
    )


def _granted(grant: Grant, topic: Topic) -> bool:
    """Return False for the key of another sensor, and for what is told with that."""
    if grant.role is not Role.SENSOR:
        return True
    return grant.topic in (topic.key, topic.told_with)
