"""The cell's mechanism, or one line that says why there is none."""

from ...config.errors import ConfigError
from ...config.load import Cell
from ...server.control.mechanism import Mechanism


def mechanism_of(cell: Cell) -> Mechanism:
    """Build the mechanism. Raises `ConfigError` where the kinematics library refuses the URDF."""
    try:
        return Mechanism.from_cell(cell)
    except (ValueError, RuntimeError) as error:
        raise ConfigError(f"{cell.robot.urdf}: {error}") from None
