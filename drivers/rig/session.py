"""The rig's own topics over Zenoh: faults in, truth out; for judges, never for the daemon.

The rig dials the daemon's router, which may not be there yet, or no longer: the session looks for
it for ever, and the rig runs on without it.
"""

import json
from collections.abc import Iterator
from typing import TypeVar

import zenoh

from ...protocols import codec, topics
from ...protocols.messages import RigFault, RigTruth
from ...protocols.moving import RigMotion
from ..device import DeviceError

_Kind = TypeVar("_Kind", RigFault, RigMotion)

_MAILBOX = 64
"""Unread faults kept; older ones are dropped for newer ones."""


def dialling_config(endpoint: str) -> "zenoh.Config":
    """Return the configuration of a session that dials `endpoint`, again and again, and no other.

    Zenoh's client mode fails where nobody answers; a peer that listens nowhere keeps trying.
    """
    config = zenoh.Config()
    settings: dict[str, object] = {
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
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": 1000,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


class RigSession:
    """A Zenoh session for the rig of one cell. Nothing here blocks, and nothing calls back.

    Raises `DeviceError` for an endpoint of a kind that Zenoh does not know.
    """

    def __init__(self, cell: str, endpoint: str) -> None:
        try:
            self._session = zenoh.open(dialling_config(endpoint))
        except zenoh.ZError:
            raise DeviceError(f"zenoh.listen: value {endpoint!r}: cannot be dialled") from None
        self._faults = self._session.declare_subscriber(
            topics.RIG_FAULT.full_key(cell), zenoh.handlers.RingChannel(_MAILBOX)
        )
        self._motions = self._session.declare_subscriber(
            topics.RIG_MOTION.full_key(cell), zenoh.handlers.RingChannel(_MAILBOX)
        )
        self._truth = self._session.declare_publisher(
            topics.RIG_TRUTH.full_key(cell),
            congestion_control=zenoh.CongestionControl.DROP,
        )
        self.refused = 0
        """Payloads that were no `RigFault` and no `RigMotion`."""

    def faults(self) -> Iterator[RigFault | RigMotion]:
        """Yield the faults that came in, oldest first, then the motions."""
        yield from self._read(self._faults, RigFault)
        yield from self._read(self._motions, RigMotion)

    def _read(
        self, box: "zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]", kind: type[_Kind]
    ) -> Iterator[_Kind]:
        for _ in range(_MAILBOX):
            sample = box.try_recv()
            if sample is None:
                return
            try:
                yield codec.decode_as(kind, sample.payload.to_bytes())
            except codec.CodecError:
                self.refused += 1

    def publish(self, truth: RigTruth) -> None:
        """Send the truth; dropped where nobody can take it."""
        self._truth.put(codec.encode(truth))

    def close(self) -> None:
        """Close the session."""
        self._session.close()  # type: ignore[no-untyped-call]  # its stubs
