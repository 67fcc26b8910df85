"""How a process takes part in the network: the one place where Zenoh is configured.

Sessions are found only at the endpoints that are named here: nothing is scouted for, and nobody
is told of anybody else. With an identity, both sides of every link show a certificate.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import zenoh

from ...protocols.topics import KEEPALIVE
from .access import enforced, reserved, trusting
from .certificates import AUTHORITY, in_cell, known
from .identity import Identity, servers

LINK_LEASE_MS = 1000
"""Zenoh takes a peer that is silent for this long for dead [ms]."""

_COMMON = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,
    "transport/link/tx/lease": LINK_LEASE_MS,
}
_AGAIN = {
    "connect/timeout_ms": -1,
    "connect/exit_on_failure": False,
    "connect/retry": {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2},
}

BATCH_BYTES = 8192
"""Messages of up to this size arrive whole; each may keep so much of the daemon's memory [B]."""

MESSAGE_BYTES = 16384
"""Longer messages, in pieces, are dropped by the daemon's Zenoh before they are whole [B]."""

BATCHES = 16
"""Batches of each priority that wait while a peer, or its link, is slow: Zenoh's most [1]."""

PRIORITIES = (
    "real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low",
    "background",
)  # fmt: skip
"""Telemetry's priority, and those that a request may choose for its reply."""

PATIENCE_US = 100
"""A tick waits so long for room for a reply; then the session of who reads none is ended [µs]."""

KEEPALIVES_HZ = 50.0
"""A router passes on so many keepalives of a peer in a second, five times as many as are due [1/s].

Each peer has its own count, so that one who floods crowds out nobody else. What is dropped was
needless, or put on many keys at once. No other key has such a bound: what comes close together
there may all be meant.
"""

# Shared memory would carry messages past the bound of their size.
_BOUNDED = {
    "transport/link/tx/batch_size": BATCH_BYTES,
    "transport/link/rx/max_message_size": MESSAGE_BYTES,
    "transport/shared_memory/enabled": False,
}
_QUEUE = "transport/link/tx/queue"
# A frame of video is put at once, in as many batches. Zenoh's own queue of two drops some of
# them whenever its thread does not run for a millisecond.
_WHOLE_FRAMES = {f"{_QUEUE}/size/background": BATCHES}
_IMPATIENT = {
    **{f"{_QUEUE}/size/{priority}": BATCHES for priority in PRIORITIES},
    f"{_QUEUE}/congestion_control/drop/wait_before_drop": 0,
    f"{_QUEUE}/congestion_control/drop/max_wait_before_drop_fragments": 0,
    f"{_QUEUE}/congestion_control/block/wait_before_close": PATIENCE_US,
}


def router_config(listen: str, cell: str = "", identity: Identity | None = None) -> "zenoh.Config":
    """Return the configuration of a cell's daemon, which others dial at `listen`.

    With an identity it lets those do what they may whose certificates lie beside its own; without,
    it lets nobody take the daemon's part. What a peer sends, or fails to read, costs the daemon
    little memory, and its ticks little time.
    """
    if identity is None:
        open_ = {"mode": "router", "listen/endpoints": [listen], **_BOUNDED, **_IMPATIENT}
        own = {"access_control": reserved(cell), "downsampling": _paced([cell])} if cell else {}
        return _config({**open_, **own})
    every, _ = known(identity.folder)
    settings = router_settings(listen, identity.folder, identity.certificate.name, [cell])
    access = {"access_control": enforced(in_cell(every, cell))}
    return _config({**settings, **_IMPATIENT, **access})


def router_settings(
    listen: str, folder: Path, name: str, cells: Iterable[str]
) -> dict[str, object]:
    """Return the settings of a cells' router that shows a certificate, but for access control."""
    shown = {**_COMMON, **_BOUNDED, **_tls(folder, name), "downsampling": _paced(cells)}
    return {"mode": "router", "listen/endpoints": [listen], **shown}


def client_config(
    endpoint: str, cell: str = "", identity: Identity | None = None
) -> "zenoh.Config":
    """Return the configuration of a client of the router at `endpoint`, and of nobody else.

    Opening it fails where nobody answers; a link that is lost later is dialled again.
    """
    settings = {"mode": "client", "connect/endpoints": [endpoint], **_WHOLE_FRAMES}
    return _config({**settings, **_trust(cell, identity)})


def member_config(
    endpoint: str, cell: str = "", identity: Identity | None = None
) -> "zenoh.Config":
    """Return the configuration of a daemon that dials a common router, as `client_config`.

    Bounded as a daemon's own router is.
    """
    settings = {"mode": "client", "connect/endpoints": [endpoint], **_BOUNDED, **_IMPATIENT}
    return _config({**settings, **_trust(cell, identity)})


def dialling_config(
    endpoint: str, cell: str = "", identity: Identity | None = None
) -> "zenoh.Config":
    """Return the configuration of a session that dials `endpoint` again and again, and no other.

    A peer that listens nowhere: Zenoh's client mode fails where nobody answers.
    """
    settings: dict[str, object] = {
        "mode": "peer",
        "connect/endpoints": [endpoint],
        "listen/endpoints": [],
    }
    return _config({**settings, **_AGAIN, **_trust(cell, identity)})


def _trust(cell: str, identity: Identity | None) -> dict[str, object]:
    """Return the settings of one who dials: its certificate, and the servers that it believes."""
    if identity is None:
        return {}
    shown = _tls(identity.folder, identity.certificate.name)
    return {**shown, "access_control": trusting(servers(identity, cell))}


def _tls(folder: Path, name: str) -> dict[str, object]:
    """Return the settings of mutual TLS; a link ends with the certificate that opened it."""
    crt, key = str(folder / f"{name}.crt"), str(folder / f"{name}.key")
    return {
        "transport/link/protocols": ["tls"],
        "transport/link/tls": {
            "root_ca_certificate": str(folder / f"{AUTHORITY}.crt"),
            "enable_mtls": True,
            "listen_certificate": crt,
            "listen_private_key": key,
            "connect_certificate": crt,
            "connect_private_key": key,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        },
    }


def _paced(cells: Iterable[str]) -> list[dict[str, object]]:
    """Return Zenoh's `downsampling` of what each peer sends for some cells."""
    rules = [{"key_expr": KEEPALIVE.full_key(cell), "freq": KEEPALIVES_HZ} for cell in cells]
    return [{"id": "keepalives", "messages": ["put"], "flows": ["ingress"], "rules": rules}]


def _config(settings: Mapping[str, object]) -> "zenoh.Config":
    config = zenoh.Config()
    for key, value in {**_COMMON, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return config


class Hearing:
    """Whether anybody listens to a publisher, as far as the network knows. Nothing calls back."""

    def __init__(self, publisher: zenoh.Publisher) -> None:
        self._changes: Any = publisher.declare_matching_listener(zenoh.handlers.RingChannel(1))
        status: Any = publisher.matching_status  # a bool, its stubs say
        self._heard = bool(status.matching)

    def __bool__(self) -> bool:
        """Take in the newest change."""
        change = self._changes.try_recv()
        if change is not None:
            self._heard = bool(change.matching)
        return self._heard
