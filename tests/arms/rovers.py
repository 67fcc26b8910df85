"""An arm of six joints on a base with wheels: written down whole, without a mesh."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from .twins import JOINTS, body, joint

RADIUS, TRACK = 0.1, 0.5
"""Of the wheels as they are where nothing else is said [m]."""
CYLINDER = '<cylinder radius="{radius}" length="0.04"/>'


class Wheel(NamedTuple):
    """A joint on the chassis, and the wheel that it turns."""

    name: str
    xyz: tuple[float, float, float]
    rpy: str = "-1.57 0 0"
    axis: str = "0 0 1"
    radius: float = RADIUS
    kind: str = "continuous"


LEFT = Wheel("left_wheel", (0.0, 0.5 * TRACK, RADIUS))
RIGHT = Wheel("right_wheel", (0.0, -0.5 * TRACK, RADIUS))
OVER_FLOOR = (("prismatic", "1 0 0"), ("prismatic", "0 1 0"), ("continuous", "0 0 1"))
"""Types and axes of joints that stand for a base which goes anywhere."""


def write_rover(
    folder: Path,
    wheels: Sequence[Wheel] = (LEFT, RIGHT),
    *,
    before: Sequence[tuple[str, str]] = (),
    lower: float = 0.0,
    suspension: str = "fixed",
) -> Path:
    """Write it, its root link `lower` above the floor [m], and joints of some types before that.

    Wheels hang on a joint of type `suspension`.
    """
    parts, at = ['<robot name="rover"><link name="floor"/>'], "floor"
    for kind, axis in before:
        limit = '<limit lower="-5" upper="5" velocity="1" effort="100"/>'
        parts += [joint(f"over_{at}", kind, (at, f"{at}_"), f'<axis xyz="{axis}"/>{limit}')]
        parts += [f'<link name="{at}_"/>']
        at = f"{at}_"
    parts += [joint("stand", "fixed", (at, "chassis"), f'<origin xyz="0 0 {-lower}"/>')]
    parts += [body("chassis", 30.0, '<box size="0.5 0.4 0.2"/>', 0.2)]
    for wheel in wheels:
        x, y, z = wheel.xyz
        rest = '<axis xyz="0 0 1"/><limit lower="-0.01" upper="0.01" velocity="1" effort="1"/>'
        parts += [joint(f"{wheel.name}_hangs", suspension, ("chassis", f"{wheel.name}_arm"), rest)]
        parts += [f'<link name="{wheel.name}_arm"/>']
        place = f'<origin xyz="{x} {y} {z}" rpy="{wheel.rpy}"/><axis xyz="{wheel.axis}"/>'
        place += '<limit lower="-9" upper="9" velocity="10" effort="20"/>'
        parts += [joint(wheel.name, wheel.kind, (f"{wheel.name}_arm", f"{wheel.name}_link"), place)]
        shape = CYLINDER.format(radius=wheel.radius)
        parts += [body(f"{wheel.name}_link", 1.0, shape, 0.0)]
    swivel = '<origin xyz="-0.2 0 0.1"/><axis xyz="0 0 1"/>'
    parts += [joint("turns", "continuous", ("chassis", "fork"), swivel)]
    parts += [body("fork", 0.2, '<sphere radius="0.02"/>', 0.0)]
    axle = '<origin xyz="-0.02 0 -0.05"/><axis xyz="0 1 0"/>'
    parts += [joint("follows", "continuous", ("fork", "small_wheel"), axle)]
    parts += [body("small_wheel", 0.2, '<sphere radius="0.05"/>', 0.0)]
    at = "chassis"
    for i, (kind, axis, xyz, bound, mass) in enumerate(JOINTS, start=1):
        place = "0.1 0 0.3" if i == 1 else xyz
        limits = f'<limit lower="-{bound}" upper="{bound}" velocity="2" effort="120"/>'
        rest = f'<origin xyz="{place}"/><axis xyz="{axis}"/>{limits}'
        parts += [joint(f"j{i}", kind, (at, f"link_{i}"), rest)]
        parts += [body(f"link_{i}", mass, '<cylinder radius="0.04" length="0.08"/>', 0.04)]
        at = f"link_{i}"
    urdf = folder / "rover.urdf"
    urdf.write_text("\n".join([*parts, "</robot>"]))
    return urdf
