"""The rig's own topics over Zenoh: faults in, truth out, for judges; and its sensors of frames.

What a sensor of a frame tells is the one thing that reaches the daemon, as any sensor's would. The
rig dials the daemon's router, which may not be there yet, or no longer: the session looks for
it for ever, and the rig runs on without it.
"""

from collections.abc import Iterator
from typing import TypeVar

import zenoh

from ...protocols import codec, topics
from ...protocols.messages.perception.moving import FrameNews, RigMotion
from ...protocols.messages.rig import RigFault, RigTruth
from ...protocols.messages.telemetry import State
from ..device import DeviceError
from ..network.identity import Identity
from ..network.sessions import dialling_config

_Kind = TypeVar("_Kind", RigFault, RigMotion, State)

_MAILBOX = 64
"""Unread faults kept; older ones are dropped for newer ones."""
_AT_ONCE = 4
"""Messages of one kind that are looked at in a physics step: a flood shall not slow it down."""


class RigSession:
    """A Zenoh session for the rig of one cell. Nothing here blocks, and nothing calls back.

    With `frames` it hears the daemon's telemetry, too, to tell which tick it is. Raises
    `DeviceError` for an endpoint of a kind that Zenoh does not know.
    """

    def __init__(
        self, cell: str, endpoint: str, identity: Identity | None = None, *, frames: bool = False
    ) -> None:
        try:
            self._session = zenoh.open(dialling_config(endpoint, cell, identity))
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
        self._states = (
            self._session.declare_subscriber(
                topics.STATE.full_key(cell), zenoh.handlers.RingChannel(1)
            )
            if frames
            else None
        )
        self._news = self._session.declare_publisher(
            topics.FRAME_NEWS.full_key(cell),
            priority=zenoh.Priority.REAL_TIME,
            congestion_control=zenoh.CongestionControl.DROP,
        )
        self.refused = 0
        """Payloads that were no `RigFault`, no `RigMotion` and no `State`."""

    def faults(self) -> Iterator[RigFault | RigMotion]:
        """Yield the faults that came in, oldest first, then the motions."""
        yield from self._read(self._faults, RigFault)
        yield from self._read(self._motions, RigMotion)

    def newest_tick(self) -> int | None:
        """Return the newest telemetry tick that came since this was asked last, if one did."""
        if self._states is None:
            return None
        ticks = [state.tick for state in self._read(self._states, State, topics.STATE.max_bytes)]
        return max(ticks, default=None)

    def tell(self, news: FrameNews) -> None:
        """Send what a sensor of a frame says; dropped where nobody can take it."""
        self._news.put(codec.encode(news))

    def _read(
        self,
        box: "zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]",
        kind: type[_Kind],
        max_bytes: int = 4096,
    ) -> Iterator[_Kind]:
        for _ in range(_AT_ONCE):
            sample = box.try_recv()
            if sample is None:
                return
            if len(sample.payload) > max_bytes:  # before it is copied
                self.refused += 1
                continue
            try:
                yield codec.decode_as(kind, sample.payload.to_bytes(), max_bytes)
            except codec.CodecError:
                self.refused += 1

    def publish(self, truth: RigTruth) -> None:
        """Send the truth; dropped where nobody can take it."""
        self._truth.put(codec.encode(truth))

    def close(self) -> None:
        """Close the session."""
        self._session.close()  # type: ignore[no-untyped-call]  # its stubs
