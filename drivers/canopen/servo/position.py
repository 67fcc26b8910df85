"""Where a drive's joint is, by its counter of 32 bits: that of a wheel wraps."""

from ....config.schema.mechanism.mechanism import DriveSection
from ....protocols.canopen.counter import Unwrapped
from . import servo_setup


class JointPosition:
    """Position of one drive's joint; an `endless` one, a wheel, has no limits."""

    def __init__(self, drive: DriveSection, endless: bool) -> None:
        self._drive, self._endless = drive, endless
        self._turns = Unwrapped()
        self._counts = 0

    def limits(self, lower: float, upper: float) -> tuple[float, float]:
        """Return the range of 607Dh for a joint with these limits [rad]."""
        return servo_setup.whole_range(self._drive) if self._endless else (lower, upper)

    def take(self, counts: int) -> None:
        """Take in a reading of 6064h."""
        self._counts = self._turns.take(counts) if self._endless else counts

    @property
    def rad(self) -> float:
        """The joint's angle [rad]."""
        return servo_setup.to_radians(self._drive, self._counts)

    @property
    def in_range(self) -> float:
        """The angle for which 607Dh needs room [rad]; wherever a wheel stands, it has enough."""
        return self._drive.zero_rad if self._endless else self.rad
