"""The potential field of one cell's arm, as the tick uses it."""

import math
from typing import NamedTuple

import numpy as np

from ....config.schema.null_space import PotentialFieldSection
from ..axes import HeldAxes
from ..inputs import ObjectiveGains
from ..joints import Joints
from ..proximity.capsules import Capsules, Placed
from ..scene import Scene
from ..spatial import Array, Kinematics, Pose
from .potentials import FieldFlow, FieldView, Potential, Strengths, shape

GIVE_WAY_GAIN = 4.0
"""How quickly the virtual link follows the field [1/s]."""

FLATTEST = 0.02
"""Where the field bends less than this part of its strength, it counts as so much [1/rad²]."""

ON_PATH = 1e-3
"""A virtual link shorter than this is none: the tool is on its path [m]."""

_NO_LINKS = np.zeros((0, 2, 3))


class FieldReading(NamedTuple):
    """The field at one posture, for telemetry."""

    parts: dict[str, float]
    """Each potential [J]."""
    slope: float
    """|Pτ|: what is left of it in the self-motions [N·m]."""


class Field:
    """The field of one cell."""

    def __init__(
        self, joints: Joints, c: PotentialFieldSection, capsules: Capsules | None, rank: int = 6
    ) -> None:
        """Build it from the cell's section; `rank` is how many axes the arm reaches anywhere.

        `capsules` are the arm's, None where nothing asks for them.
        """
        self._link = c.virtual_link
        self._capsules = capsules
        self._to_posture = c.rest == "posture"
        body = np.zeros(0, dtype=np.int64) if capsules is None else capsules.body
        k = Strengths(c.obstacles, c.lines, c.joint_limits, c.manipulability)
        smooth = c.line_model == "smooth"
        potential = Potential(joints.lower, joints.upper, body, k, c.least_distance, smooth, rank)
        self.flow = FieldFlow(potential, body, max(FLATTEST * max(k), 1e-9))
        link = c.virtual_link
        self._repels = capsules is not None and (k.obstacles > 0.0 or k.lines > 0.0)
        self._always = k.joint_limits > 0.0 or k.manipulability > 0.0 or link is not None
        """Something is felt without obstacles too."""
        self._direction = np.zeros(3)
        if link is not None:
            self._direction = np.array(link.direction) / math.hypot(*link.direction)

    def look(
        self,
        q: Array,
        k: Kinematics,
        scene: Scene | None,
        objectives: ObjectiveGains,
        T_world_base: Pose | None = None,
        placed: Placed | None = None,
        held: HeldAxes | None = None,
    ) -> FieldView | None:
        """Return what there is to know of the field at q (n,) [rad].

        None if nothing follows it, or there is none: neither obstacles nor what acts without them.
        `T_world_base` is where a Base that moves is now, `placed` where links are at q, where that
        is known already; `held` which axes the task holds, None for all.
        """
        if objectives.gains["field"] <= 0.0 and self._link is None:
            return None
        among, ends = self._among(k, scene), _NO_LINKS
        if among is None and not self._always:
            return None
        if among is not None and self._capsules is not None:
            ends = (placed or self._capsules.place(q[None], T_world_base)).ends[0]
        rest = objectives.posture if self._to_posture else None
        return self.flow.look(shape(q, k.J, k.T_world_mrf.p, ends), among, rest, held)

    def self_motion(
        self, seen: FieldView | None, null: Array
    ) -> tuple[Array | None, FieldReading | None]:
        """Return the joint rates (n,) to the least potential, at a gain of 1 /s, and the field.

        `null` (r, n) has orthonormal rows that span the self-motions.
        """
        if seen is None:
            return None, None
        rates, slope = self.flow.self_motion(seen, null)
        return rates, FieldReading(seen.value.parts, slope)

    def give_way(
        self, seen: FieldView | None, off_path: Array | None, on_way: bool, factor: float
    ) -> Array | None:
        """Return the velocity (3,) [m/s] at which the tool leaves its path, or comes back.

        `off_path` (3,) is where it is off its path now [m], `on_way` tells whether it is led along
        one, `factor` is the reduced-speed setting. None where there is no path to leave.
        """
        link = self._link
        if link is None or seen is None or not on_way:
            return None
        d = 0.0 if off_path is None else float(off_path @ self._direction)
        speed = GIVE_WAY_GAIN * self.flow.along(seen, self._direction, d, link.stiffness)
        most = factor * link.speed
        # Towards either end no faster than it can be stopped before.
        low = max(-most, GIVE_WAY_GAIN * (-link.longest - d))
        high = min(most, GIVE_WAY_GAIN * (link.longest - d))
        return np.asarray(min(high, max(low, speed)) * self._direction)

    def _among(self, k: Kinematics, scene: Scene | None) -> Scene | None:
        """Return what repels the links, where it is now; None if nothing does."""
        if scene is None or not self._repels or not scene.names:
            return None
        return scene.placed(k.T_world_wrist)


def on_path(off_path: Array | None) -> bool:
    """Return whether the tool is where its path is, but for what cannot be told from it."""
    return off_path is None or float(off_path @ off_path) < ON_PATH**2


def shifted(twist: Array, give_way: Array | None) -> Array:
    """Return a twist (6,), and the velocity (3,) along the virtual link, if any, on top."""
    if give_way is None:
        return twist
    return np.concatenate([twist[:3] + give_way, twist[3:]])


def advance_offset(off_path: Array | None, give_way: Array | None, seconds: float) -> Array | None:
    """Return where the tool is off its path (3,) [m] after giving way for a while."""
    if give_way is None:
        return None  # without a path there is nothing to come back to
    way = seconds * give_way
    return way if off_path is None else off_path + way
