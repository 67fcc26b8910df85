"""What must be said aloud of the operators' network: that it is open to all, or soon to nobody."""

from typing import Literal

from ...config.load import Cell
from ...drivers.network.certificates import known
from ...drivers.network.identity import Identity
from ..runtime.events import Events


def network(cell: Cell) -> Literal["local", "certified", "insecure"]:
    """Return who may speak to a daemon: this machine, who shows a certificate, or anybody."""
    zenoh = cell.config.zenoh
    if zenoh.exposed:
        return "insecure"
    return "local" if zenoh.security.directory is None else "certified"


def exposure(cell: Cell) -> list[str]:
    """Return in words that anybody who reaches the daemon may command; empty if not so."""
    if network(cell) != "insecure":
        return []
    return [
        f"INSECURE: {cell.config.zenoh.endpoint} reaches beyond this machine without certificates: "
        "anybody there may read, command and stop this arm"
    ]


def opening_events(cell: Cell) -> Events:
    """Return the events of a run that begins; the first says that anybody may command."""
    events = Events()
    for words in exposure(cell):
        events.standing("insecure", words, endpoint=cell.config.zenoh.endpoint)
    return events


def doubts(identity: Identity | None) -> list[str]:
    """Return in words which certificates of the daemon's folder end soon, or are of no use."""
    return [] if identity is None else known(identity.folder)[1]
