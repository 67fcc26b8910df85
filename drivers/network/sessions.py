"""How a process takes part in the network: the one place where Zenoh is configured.

Sessions are found only at the endpoints that are named here: nothing is scouted for, and nobody
is told of anybody else. With an identity, both sides of every link show a certificate.
"""

import json
from collections.abc import Mapping
from pathlib import Path

import zenoh

from .access import enforced, trusting
from .identity import AUTHORITY, Identity, in_cell, known, servers

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


def router_config(listen: str, cell: str = "", identity: Identity | None = None) -> "zenoh.Config":
    """Return the configuration of a cell's daemon, which others dial at `listen`.

    With an identity it lets those do what they may whose certificates lie beside its own.
    """
    if identity is None:
        return _config({"mode": "router", "listen/endpoints": [listen]})
    every, _ = known(identity.folder)
    settings = router_settings(listen, identity.folder, identity.certificate.name)
    return _config({**settings, "access_control": enforced(in_cell(every, cell))})


def router_settings(listen: str, folder: Path, name: str) -> dict[str, object]:
    """Return the settings of a router that shows a certificate, without its access control."""
    return {"mode": "router", "listen/endpoints": [listen], **_COMMON, **_tls(folder, name)}


def client_config(
    endpoint: str, cell: str = "", identity: Identity | None = None
) -> "zenoh.Config":
    """Return the configuration of a client of the router at `endpoint`, and of nobody else.

    Opening it fails where nobody answers; a link that is lost later is dialled again.
    """
    return _config({"mode": "client", "connect/endpoints": [endpoint], **_trust(cell, identity)})


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


def _config(settings: Mapping[str, object]) -> "zenoh.Config":
    config = zenoh.Config()
    for key, value in {**_COMMON, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return config
