"""Telemetry of what is driven as a whole: an arm in its tunnels, a base on wheels."""

from ...config.load import Cell
from ..control.arm.arm import Arm
from ..control.mechanism.backbone.chain import Chain
from ..control.mechanism.backbone.insertion import Insertion


def told_insertion(arm: Arm, insertion: Insertion | None) -> dict[str, float] | None:
    """Return where an arm is along its curve; None for a plain arm, and for one off its curve."""
    slither = arm.stages.slither
    if slither is None or insertion is None:
        return None
    backbone = slither.backbone
    return {
        "depth": backbone.depth(insertion),
        "speed": insertion.speed,
        "free": float(backbone.chain.n - insertion.beyond),
    }


def described_insertion(part: Cell) -> dict[str, float] | None:
    """Return how fast and how deep an arm may be inserted; None for one without a backbone."""
    backbone = part.config.mechanism.backbone
    if backbone is None:
        return None
    return {"speed": backbone.speed, "depth": Chain.from_cell(part).length - backbone.least}


def described_base(part: Cell) -> dict[str, float] | None:
    """Return how fast a base may be driven [m/s], [rad/s]; None for one that has no wheels."""
    base = part.config.mechanism.base
    if base is None:
        return None
    return {"speed": base.speed, "angular_speed": base.angular_speed}
