"""Chains that never reach all six axes: planar ones, and one of five joints."""

import numpy as np
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.spatial import Pose

_LINK = (
    '<link name="l{0}"><inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" '
    'iyz="0" izz="0.01"/></inertial></link>'
)
_JOINT = (
    '<joint name="j{0}" type="{1}"><parent link="l{0}"/><child link="l{2}"/><origin xyz="{3}"/>'
    '<axis xyz="{4}"/><limit lower="-3" upper="3" velocity="2" effort="100"/></joint>'
)

AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


def chain(axes: str, step: str = "0.3 0 0", *steps: str) -> Mechanism:
    """Return a chain of turning joints about `axes`, of "x", "y" and "z", equal steps apart.

    Or by `steps` of their own, from the first joint to the second on.
    """
    n = len(axes)
    apart = [step, *(steps or [step] * n)]
    links = [_LINK.format(i) for i in range(n + 2)]
    joints = [
        _JOINT.format(i, "revolute", i + 1, apart[i], AXES[axis]) for i, axis in enumerate(axes)
    ]
    joints.append(_JOINT.format(n, "fixed", n + 1, apart[n], AXES["z"]))
    text = "\n".join(['<robot name="chain">', *links, *joints, "</robot>"])
    base = Pose(np.eye(3), np.array([0.1, -0.2, 0.3]))
    return Mechanism(text, tuple(f"j{i}" for i in range(n)), f"l{n + 1}", base)


CHAINS = {
    "planar of two": (chain("zz"), 2),
    "planar of three": (chain("zzz"), 3),
    "planar of five": (chain("zzzzz"), 3),
    "five joints": (chain("zyyxy", "0.2 0.05 0.1"), 5),
    "one that turns three ways": (chain("zyxzyx", "0 0 0"), 3),
}
"""Each with the number of axes that it reaches."""
