"""Commands that drive an arm into its tunnels and out: a stream of speed, or a depth to go to."""

from typing import Self

from ...config.load import Cell
from ...config.schema.mechanism.backbone import BackboneSection
from ...protocols.messages.drive import Drive, Insert
from ..control.mechanism.backbone.chain import Chain
from ..control.mechanism.backbone.insertion import STILL, DriveRequest
from ..control.spatial import Pose
from ..refusals import Refused, Why
from .streams import Stream


class InsertionCommands:
    """How the operator drives one arm; without a backbone every command is refused."""

    def __init__(self, backbone: BackboneSection | None, length: float, timeout_s: float) -> None:
        """Build it for an arm of a length from its first joint to its tip [m]."""
        self._backbone, self._length = backbone, length
        self._stream = Stream[Drive](timeout_s)
        self._goal: DriveRequest | None = None

    @classmethod
    def from_cell(cls, cell: Cell) -> Self:
        """Return those of a cell's mechanism. Raises `ConfigError` where it is no chain."""
        backbone, timeout_s = cell.config.mechanism.backbone, cell.config.timing.stream_timeout_s
        return cls(backbone, Chain.from_cell(cell).length if backbone else 0.0, timeout_s)

    def take(self, message: Drive | Insert, now_s: float, _T: Pose) -> None:
        """Put a speed or a depth in force; each ends the other, but for a speed of 0.

        Raises `Refused`.
        """
        if self._backbone is None:
            raise Refused(Why.UNKNOWN_MECHANISM, "the mechanism has no backbone to be inserted")
        if isinstance(message, Drive):
            self._take_drive(message, now_s, self._backbone)
        else:
            self._take_goal(message, self._backbone)

    def _take_drive(self, message: Drive, now_s: float, backbone: BackboneSection) -> None:
        if len(message.rates) != 1:
            raise Refused(Why.OUT_OF_RANGE, f"rates: {len(message.rates)} values: one is expected")
        if abs(message.rates[0]) > backbone.speed * (1 + 1e-9):
            raise Refused(
                Why.OUT_OF_RANGE,
                f"rates: {message.rates[0]:g} m/s: at most {backbone.speed:g} either way",
            )
        if message.rates[0]:
            self._goal = None
        self._stream.take(message, now_s)

    def _take_goal(self, message: Insert, backbone: BackboneSection) -> None:
        deepest = self._length - backbone.least
        if message.depth > deepest + 1e-9:
            raise Refused(Why.OUT_OF_RANGE, f"depth: {message.depth:g} m: at most {deepest:.4f} m")
        self._stream.clear()
        self._goal = DriveRequest(
            min(message.speed or backbone.speed, backbone.speed), message.depth
        )

    def newest(self, now_s: float) -> DriveRequest:
        """Return what is in force now."""
        if self._goal is not None:
            return self._goal
        message = self._stream.newest(now_s)
        return STILL if message is None else DriveRequest(message.rates[0])

    def expired(self, now_s: float) -> bool:
        """Return whether a drive fell silent that was to move, and forget it."""
        message = self._stream.expire(now_s)
        return message is not None and any(message.rates)

    def drop(self) -> None:
        """Drop the goal."""
        self._goal = None

    def clear(self) -> None:
        """Drop goal and stream."""
        self._stream.clear()
        self._goal = None
