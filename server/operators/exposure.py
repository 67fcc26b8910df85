"""Exposure of the operators' network: warnings where it is open to all, or soon to nobody."""

from typing import Literal

from ...config.schema.security import ZenohSection
from ...drivers.network.certificates import known
from ...drivers.network.identity import Identity
from ..runtime.events import Events


def network(zenoh: ZenohSection) -> Literal["local", "certified", "insecure"]:
    """Return who may speak to a daemon: this machine, who shows a certificate, or anybody."""
    if zenoh.exposed:
        return "insecure"
    return "local" if zenoh.security.directory is None else "certified"


def exposure(zenoh: ZenohSection) -> list[str]:
    """Return in words that anybody who reaches the daemon may command; empty if not so."""
    if network(zenoh) != "insecure":
        return []
    return [
        f"INSECURE: {zenoh.endpoint} reaches beyond this machine without certificates: "
        "anybody there may read, command and stop this arm"
    ]


def opening_events(zenoh: ZenohSection) -> Events:
    """Return the events of a run that begins; the first says that anybody may command."""
    events = Events()
    for words in exposure(zenoh):
        events.standing("insecure", words, endpoint=zenoh.endpoint)
    return events


def doubts(identity: Identity | None) -> list[str]:
    """Return in words which certificates of the daemon's folder end soon, or are of no use."""
    return [] if identity is None else known(identity.folder)[1]
