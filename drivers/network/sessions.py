"""How a process takes part in the network: the one place where Zenoh is configured.

Sessions are found only at the endpoints that are named here: nothing is scouted for, and nobody
is told of anybody else.
"""

import json
from collections.abc import Mapping

import zenoh

LINK_LEASE_MS = 1000
"""Zenoh takes a peer that is silent for this long for dead [ms]."""


def router_config(listen: str) -> "zenoh.Config":
    """Return the configuration of a router, which others dial at `listen`: the daemon's."""
    return _config({"mode": "router", "listen/endpoints": [listen]})


def client_config(endpoint: str) -> "zenoh.Config":
    """Return the configuration of a client of the router at `endpoint`, and of nobody else.

    Opening it fails where nobody answers.
    """
    return _config({"mode": "client", "connect/endpoints": [endpoint]})


def dialling_config(endpoint: str) -> "zenoh.Config":
    """Return the configuration of a session that dials `endpoint` again and again, and no other.

    A peer that listens nowhere: Zenoh's client mode fails where nobody answers.
    """
    return _config(
        {
            "mode": "peer",
            "connect/endpoints": [endpoint],
            "listen/endpoints": [],
            "connect/timeout_ms": -1,
            "connect/exit_on_failure": False,
            "connect/retry": {
                "period_init_ms": 200,
                "period_max_ms": 1000,
                "period_increase_factor": 2,
            },
        }
    )


def _config(settings: Mapping[str, object]) -> "zenoh.Config":
    config = zenoh.Config()
    common = {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": LINK_LEASE_MS,
    }
    for key, value in {**common, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return config
