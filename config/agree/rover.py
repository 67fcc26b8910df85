"""Needs of a base on wheels, and of the contour ahead of it, in the cell's other sections."""

from collections.abc import Iterator

from ..errors import nearest
from ..schema.cell import CellConfig
from ..urdf.robot import Robot


def rover_disagreements(config: CellConfig, robot: Robot) -> Iterator[str]:
    """Yield what does not fit, each in one line with its key."""
    yield from _news(config)
    if config.contour is None:
        return
    if config.scanner is None:
        yield "contour: there is no [scanner] that sees it"
    names = [joint.name for joint in robot.joints]
    beside = config.mechanism.beside_chain
    for key in ("shoulder", "elbow"):
        name = getattr(config.contour, key)
        if name not in names or name in beside:
            arm = [each for each in names if each not in beside]
            yield f"contour.{key}: value '{name}': no such joint of the arm{nearest(name, arm)}"


def _news(config: CellConfig) -> Iterator[str]:
    """News of Base is not believed if it moves faster than `[frames.base]` says."""
    base, told = config.mechanism.base, config.frames.base
    if base is None or told is None:
        return
    drives = [d for d in config.mechanism.drives if d.joint in config.mechanism.wheels]
    rim = base.wheels.radius * max((d.max_acceleration for d in drives), default=0.0)
    for key, goes in (
        ("speed", base.speed),
        ("angular_speed", base.angular_speed),
        ("acceleration", rim),
        ("angular_acceleration", 2.0 * rim / base.wheels.track),
    ):
        value = getattr(told, key)
        if value < goes:
            yield (
                f"frames.base.{key}: value {value:g}: must be at least {goes:.4g}, which its "
                "wheels do: no news of a base that drives would be believed"
            )
