"""Check of a base's wheels: their places in the URDF, and the speeds that driving takes."""

from collections.abc import Iterator

from ....config.load import Cell
from ....config.schema.mechanism import DifferentialBaseSection
from ....server.control.proximity.capsules import Forest
from ....server.control.wheels import DifferentialDrive
from ..findings import Finding, Severity, graded

NOTICE, MOST = 0.01, 0.05
"""A radius or track that is wrong by these shares spoils the odometry by as much [1]."""


def wheels(cell: Cell) -> Iterator[Finding]:
    """Judge the wheels of a base; nothing without one."""
    base, rolling = cell.config.mechanism.base, DifferentialDrive.from_cell(cell)
    if base is None or rolling is None:
        return
    yield _places(cell, base)
    yield _speed(cell, base, rolling)


def _places(cell: Cell, base: DifferentialBaseSection) -> Finding:
    """Judge radius and track against the wheels' axles in the URDF; Base is on the floor."""
    model, told = Forest(cell).branches[0].model, base.wheels
    left, right = (
        model.jointPlacements[model.getJointId(name)].translation
        for name in (told.left, told.right)
    )
    track, radius = float(left[1] - right[1]), float(0.5 * (left[2] + right[2]))
    off = max(abs(track / told.track - 1.0), abs(radius / told.radius - 1.0))
    return Finding(
        "base wheels",
        graded(off, NOTICE, MOST),
        f"axles {track:g} m apart from right to left and {radius:g} m high in the URDF; track "
        f"{told.track:g} and radius {told.radius:g} in the cell: {off:.1%} off, at most {MOST:.0%}",
        {"urdf_track": track, "urdf_radius": radius, "off": off, "limit": MOST},
    )


def _speed(cell: Cell, base: DifferentialBaseSection, rolling: DifferentialDrive) -> Finding:
    """Judge the wheels' speed bounds: straight on, and with all of the turning beside it."""
    drives = {drive.joint: drive.max_velocity for drive in cell.config.mechanism.drives}
    least = min(drives[base.wheels.left], drives[base.wheels.right])
    straight = float(rolling.wheels(base.speed, 0.0).max())
    alone = float(rolling.wheels(0.0, base.angular_speed).max())
    both = straight + alone
    status = Severity.ERROR if max(straight, alone) > least else graded(both, least, both)
    return Finding(
        "base speed",
        status,
        f"the faster wheel turns at {straight:.3g} rad/s straight on, {alone:.3g} on the spot, "
        f"{both:.3g} with both; max_velocity {least:g}",
        {"straight": straight, "on_the_spot": alone, "both": both, "max_velocity": least},
    )
