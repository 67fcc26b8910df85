"""A robot with two arms on one torso, that drives about: written down whole, without a mesh."""

from pathlib import Path

JOINTS = [  # type, axis, from the last joint [m], bound [rad], mass [kg]
    ("revolute", "0 0 1", "0 0 0.10", 2.6, 2.0),
    ("revolute", "0 1 0", "0 0 0.10", 2.0, 2.0),
    ("revolute", "0 1 0", "0 0 0.28", 2.4, 1.5),
    ("revolute", "0 0 1", "0 0 0.12", 2.9, 0.8),
    ("revolute", "0 1 0", "0 0 0.14", 2.0, 0.6),
    ("revolute", "0 0 1", "0 0 0.08", 2.9, 0.3),
]
BASES = {
    "planar": [("planar", "0 0 1", "drive")],
    "virtual": [
        ("prismatic", "1 0 0", "slide_x"),
        ("prismatic", "0 1 0", "slide_y"),
        ("continuous", "0 0 1", "turn"),
    ],
}


def body(name: str, mass: float, shape: str, z: float) -> str:
    """Return a link with mass and a shape that stands on its frame."""
    return (
        f'<link name="{name}"><inertial><origin xyz="0 0 {z}"/><mass value="{mass}"/>'
        f'<inertia ixx="{0.01 * mass}" ixy="0" ixz="0" iyy="{0.01 * mass}" iyz="0" '
        f'izz="{0.005 * mass}"/></inertial><collision><origin xyz="0 0 {z}"/>'
        f"<geometry>{shape}</geometry></collision></link>"
    )


def joint(name: str, kind: str, ends: tuple[str, str], rest: str) -> str:
    """Return a joint between two links."""
    above, below = ends
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{above}"/><child link="{below}"/>'
        f"{rest}</joint>"
    )


def write_twins(folder: Path, base: str = "planar") -> Path:
    """Write it: a base that moves over the floor, wheels, a torso that lifts, arms, grippers."""
    parts, at = ['<robot name="twins"><link name="floor"/>'], "floor"
    for kind, axis, name in BASES[base]:
        limit = '<limit lower="-5" upper="5" velocity="1" effort="100"/>'
        parts += [joint(name, kind, (at, f"after_{name}"), f'<axis xyz="{axis}"/>{limit}')]
        parts += [body(f"after_{name}", 9.0, '<box size="0.3 0.3 0.1"/>', 0.05)]
        at = f"after_{name}"
    for side in ("left", "right"):
        place = f'<origin xyz="0 {0.2 if side == "left" else -0.2} 0"/><axis xyz="0 1 0"/>'
        parts += [joint(f"{side}_wheel_joint", "continuous", (at, f"{side}_wheel"), place)]
        parts += [body(f"{side}_wheel", 1.0, '<sphere radius="0.05"/>', 0.0)]
    lift = '<origin xyz="0 0 0.1"/><axis xyz="0 0 1"/>'
    lift += '<limit lower="0" upper="0.3" velocity="0.1" effort="900"/>'
    parts += [joint("lift", "prismatic", (at, "torso"), lift)]
    parts += [body("torso", 20.0, '<cylinder radius="0.12" length="0.5"/>', 0.3)]
    for side, y in (("left", 0.22), ("right", -0.22)):
        above = "torso"
        for i, (kind, axis, xyz, bound, mass) in enumerate(JOINTS, start=1):
            name = f"{side}_{i}"
            place = f"0 {y} 0.5" if i == 1 else xyz
            rest = f'<origin xyz="{place}"/><axis xyz="{axis}"/>'
            rest += f'<limit lower="-{bound}" upper="{bound}" velocity="2" effort="120"/>'
            parts += [joint(f"{side}_joint_{i}", kind, (above, name), rest)]
            parts += [body(name, mass, '<cylinder radius="0.035" length="0.08"/>', 0.04)]
            above = name
        hand = f"{side}_gripper"
        parts += [joint(f"{hand}_mount", "fixed", (above, hand), '<origin xyz="0 0 0.09"/>')]
        parts += [body(hand, 0.2, '<box size="0.05 0.05 0.04"/>', 0.02)]
        for k in (1, 2):
            mimic = f'<mimic joint="{hand}_finger_1"/>' if k == 2 else ""
            rest = f'<origin xyz="0 0 0.04"/><axis xyz="1 0 0"/>{mimic}'
            rest += '<limit lower="0" upper="0.02" velocity="0.1" effort="10"/>'
            finger = (hand, f"{hand}_tip_{k}")
            parts += [joint(f"{hand}_finger_{k}", "prismatic", finger, rest)]
            parts += [body(f"{hand}_tip_{k}", 0.02, '<box size="0.01 0.02 0.04"/>', 0.02)]
    path = folder / "twins.urdf"
    path.write_text("\n".join([*parts, "</robot>"]))
    return path
