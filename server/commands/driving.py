"""The command that drives a base on wheels: a stream of its speed ahead and about its axis."""

from ...config.load import Cell
from ...config.schema.mechanism.base import DifferentialBaseSection
from ...protocols.messages.drive import Drive, Insert
from ..control.mechanism.backbone.insertion import STILL, DriveRequest
from ..control.spatial import Pose
from ..refusals import Refused, Why
from .insertion import InsertionCommands
from .streams import Stream


class BaseCommands:
    """How the operator drives one base."""

    def __init__(self, base: DifferentialBaseSection, timeout_s: float) -> None:
        """Build it; a drive is in force for `timeout_s` after it came."""
        self._base = base
        self._stream = Stream[Drive](timeout_s)

    def take(self, message: Drive | Insert, now_s: float, _T: Pose) -> None:
        """Put a drive in force. Raises `Refused`."""
        if isinstance(message, Insert):
            raise Refused(Why.UNKNOWN_MECHANISM, "the mechanism has no backbone to be inserted")
        rates, base = message.rates, self._base
        if len(rates) != 2:
            raise Refused(Why.OUT_OF_RANGE, f"rates: {len(rates)} values: two are expected")
        each = zip(rates, (base.speed, base.angular_speed), ("m/s", "rad/s"), strict=True)
        for i, (value, most, unit) in enumerate(each):
            if abs(value) > most * (1 + 1e-9):
                words = f"rates[{i}]: {value:g} {unit}: at most {most:g} either way"
                raise Refused(Why.OUT_OF_RANGE, words)
        self._stream.take(message, now_s)

    def newest(self, now_s: float) -> DriveRequest:
        """Return what is in force now."""
        message = self._stream.newest(now_s)
        return STILL if message is None else DriveRequest(message.rates[0], turn=message.rates[1])

    def expired(self, now_s: float) -> bool:
        """Return whether a drive fell silent that was to move, and forget it."""
        message = self._stream.expire(now_s)
        return message is not None and any(message.rates)

    def drop(self) -> None:
        """Keep the drive: it is no goal."""

    def clear(self) -> None:
        """Forget the drive."""
        self._stream.clear()


DriveCommands = BaseCommands | InsertionCommands
"""How the operator drives a mechanism as a whole."""


def drive_commands(cell: Cell) -> DriveCommands:
    """Return those of a cell's mechanism: of its base, or into its tunnels."""
    base = cell.config.mechanism.base
    if base is None:
        return InsertionCommands.from_cell(cell)
    return BaseCommands(base, cell.config.timing.stream_timeout_s)
