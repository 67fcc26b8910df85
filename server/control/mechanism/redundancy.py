"""Motion of the spare degrees of freedom: objectives summed, projected, bounded; what precedes."""

import math
from collections.abc import Mapping
from typing import Final, NamedTuple, Self

import numpy as np

from ....config.load import Cell
from ....config.schema.null_space import PotentialFieldSection, PrioritySection, RedundancySection
from ..axes import HeldAxes
from ..compiled import MATRIX, NUMBER, ROW, VECTOR, compiled
from ..inputs import ObjectiveGains, VirtualLinks
from ..joints import Joints
from ..proximity.capsules import Capsules, Placed
from ..proximity.pairs import ControlPointDistances, ControlPoints
from ..scene import Scene
from ..spatial import Array, Kinematics, Pose
from .model import Dynamics
from .objectives import KINDS, View
from .potentials import FieldFlow, FieldView, Potential, Strengths, shape

# --- Motion of the spare degrees of freedom: the objectives' rates, summed, projected and bounded
#
# Williams 1997, eq. 7: dq = J⁺ẋ + (I − J⁺J) z. Every objective has a gain, which is ramped like
# the sources' gains; one whose gain is zero is not computed.

_NONE: Final = 1e-12
"""Keeps a bound or a motion of nothing from dividing by zero [rad/s]."""


class SelfMotion(NamedTuple):
    """Request to the null space."""

    dq: Array
    """Joint rates (n,) in the null space [rad/s]."""
    norms: dict[str, float]
    """Size of each objective's own part of it [rad/s]; they may cancel."""


class Redundancy:
    """Composes the objectives of one mechanism."""

    def __init__(
        self, joints: Joints, dynamics: Dynamics, section: RedundancySection, pull_posture: Array
    ) -> None:
        """Build it from the cell's section; the posture objective pulls to `pull_posture` (n,)."""
        self._objectives = {n: kind(joints, dynamics, section) for n, kind in KINDS.items()}
        self._spare = joints.n > dynamics.mechanism.rank
        self._velocity = joints.velocity
        self._bound = section.max_rate * joints.velocity
        self.objectives = ObjectiveGains(section.gains, pull_posture)
        """Those of the cell file."""
        self._none = SelfMotion(np.zeros(joints.n), {})
        self._none.dq.flags.writeable = False
        # Scratch: of the gains seen last, which objectives act, and their gains.
        self._acting: tuple[ObjectiveGains | None, list[str], Array] = (None, [], np.zeros(0))

    def none(self) -> SelfMotion:
        """Return an idle null space."""
        return self._none

    def ramped(self, now: ObjectiveGains, target: ObjectiveGains, part: float) -> ObjectiveGains:
        """Return the gains a `part` (0 to 1) of the way from those in effect to the set ones."""
        if now is target:
            return target
        gains = {}
        for name, goal in target.gains.items():
            way = goal - now.gains[name]
            gains[name] = goal if abs(way) < 1e-6 else now.gains[name] + part * way
        away = target.posture - now.posture
        pulls = now.gains["posture"] or now.gains["field"]
        if not pulls or float(np.abs(away).max()) < 1e-6:
            part = 1.0  # a pull that does not act yet may be aimed anew at once
        if gains == target.gains and part == 1.0:
            return target
        return ObjectiveGains(gains, now.posture + part * away)

    def rate(
        self,
        view: View,
        objectives: ObjectiveGains,
        factor: float,
        scale: Array | None = None,
        own: Array | None = None,
    ) -> SelfMotion:
        """Return the self-motion in one tick's `view`.

        `factor` is the reduced-speed setting, which scales the bound of the self-motion. Of what
        the objectives ask for, the task leaves s room: the most with |dq_task + s dq| ≤ V, so that
        no self-motion slows the tool.

        Joints that share the work unequally, as `scale` D (n,) says, have `null` of J D: then the
        projector is the oblique D nullᵀ null D⁻¹. Joints where `own` (n,) is 0 have no wishes of
        their own.
        """
        names, gains = self._act(objectives)
        spare = self._spare if view.held is None else len(view.null) > 0
        if not spare or not names:
            return self._none
        n, dq_task, null = len(view.q), view.dq_task, view.null
        asked, dq, norms = np.empty((len(names), n)), np.zeros(n), np.zeros(len(names))
        for i, name in enumerate(names):
            asked[i] = self._objectives[name].rate(view)
        if own is not None:
            asked *= own
        if scale is None:
            _compose(asked, gains, null, dq_task, self._velocity, self._bound, factor, dq, norms)
        else:
            task, most, bound = dq_task / scale, self._velocity / scale, self._bound / scale
            _compose(asked / scale, gains, null, task, most, bound, factor, dq, norms)
            dq *= scale
        return SelfMotion(dq, dict(zip(names, norms.tolist(), strict=True)))

    def whole(
        self, q: Array, J: Array, objectives: ObjectiveGains, outside: Mapping[str, Array]
    ) -> dict[str, Array]:
        """Return the joint rates (n,) of the objectives that are taken whole, by name.

        `outside` holds what they are asked for (n,) at a gain of 1; the others ask for nothing.
        """
        view = View(q, J, self._none.dq, np.zeros((0, len(q))), objectives.posture, outside)
        gains = {name: objectives.gains.get(name, 0.0) for name in outside if KINDS[name].WHOLE}
        return {
            name: gain * self._objectives[name].rate(view)
            for name, gain in gains.items()
            if gain > 0.0
        }

    def _act(self, objectives: ObjectiveGains) -> tuple[list[str], Array]:
        """Return the objectives that act (k,), and their gains (k,)."""
        if objectives is not self._acting[0]:
            names = [
                name
                for name, gain in objectives.gains.items()
                if gain > 0.0 and not KINDS[name].WHOLE
            ]
            self._acting = objectives, names, np.array([objectives.gains[name] for name in names])
        return self._acting[1:]


@compiled(MATRIX, VECTOR, MATRIX, VECTOR, VECTOR, VECTOR, NUMBER, ROW, ROW)
def _compose(
    asked: Array,
    gains: Array,
    null: Array,
    dq_task: Array,
    velocity: Array,
    most: Array,
    factor: float,
    dq: Array,
    norms: Array,
) -> None:
    """Write the self-motion (n,) and the size (k,) of each objective's part of it [rad/s].

    Objectives ask for rates (k, n) at gains (k,). Of joints' speed bounds (n,), and of those of
    self-motion, counts the part that is the reduced-speed setting. What is written is zeros before.
    """
    objectives, n = asked.shape
    part = np.empty(n)
    for i in range(objectives):
        for j in range(n):
            part[j] = 0.0
        for row in range(len(null)):
            along = 0.0
            for j in range(n):
                along += null[row, j] * asked[i, j]
            for j in range(n):
                part[j] += gains[i] * along * null[row, j]
        for j in range(n):
            dq[j] += part[j]
            norms[i] += part[j] * part[j]
    beyond = slowed = 1.0
    for j in range(n):
        beyond = max(beyond, abs(dq[j]) / max(factor * most[j], _NONE))
        slowed = max(slowed, abs(dq_task[j]) / (factor * velocity[j]))
    share = 1.0 / beyond
    fits = 1.0
    for j in range(n):
        room = factor * velocity[j] - np.sign(dq[j]) * dq_task[j] / slowed
        fits = min(fits, max(room, 0.0) / max(share * abs(dq[j]), _NONE))
    share *= fits
    for j in range(n):
        dq[j] *= share
    for i in range(objectives):
        norms[i] = share * math.sqrt(norms[i])


# --- Avoidance that precedes following (Hamaguchi, Taniguchi, section 3) --------------------------
#
# Obstacles inside the virtual spheres ask some joints for rates ξ, which the null space takes
# (eqs. 7, 8), and leave less and less of the hand's force to be followed: (1 − α) of it (eqs.
# 9, 10).

LEVEL = 0.005
"""Slope of the distance in a joint's self-motion below which its rate fades [m/rad]: where neither
way leads away from an obstacle, no sign is right."""

RELEASE_S = 0.2
"""α rises at once, and falls from 1 to 0 in no less than this [s]."""


class Near(NamedTuple):
    """Distances of the virtual spheres from obstacles, and the priority that follows."""

    names: tuple[str, ...]
    distances: ControlPointDistances
    alpha: float
    """Priority of avoiding, 0 to 1."""


class Priority:
    """The virtual spheres of one cell, and the law of eqs. 8 to 10."""

    def __init__(
        self, law: PrioritySection, points: ControlPoints, joints: Array, period_s: float
    ) -> None:
        """`joints` (n,) has ones where the joint's rate avoids, zeros elsewhere."""
        self._law, self._points, self._joints = law, points, joints
        self._names = tuple(sphere.name for sphere in law.spheres)
        self._release = period_s / RELEASE_S

    @classmethod
    def from_cell(cls, cell: Cell) -> Self | None:
        """Build what a cell describes, None where it has no spheres. Raises `ConfigError`."""
        law = cell.config.priority
        if law is None:
            return None
        joints = np.array([float(joint.name in law.joints) for joint in cell.robot.joints])
        return cls(law, ControlPoints(cell, law.spheres), joints, cell.config.timing.period_s)

    def look(
        self, q: Array, scene: Scene | None, before: Near | None, T_world_base: Pose | None = None
    ) -> Near:
        """Return what is near at joint angles q (n,) [rad]; `before` is that of the last tick."""
        distances = self._points.look(q, scene, T_world_base)
        alpha = alpha_of(distances.least, self._law) if self._law.precedence else 0.0
        if before is not None:
            alpha = max(alpha, before.alpha - self._release)
        return Near(self._names, distances, alpha)

    def rates(self, near: Near, null: Array) -> Array:
        """Return ξ (n,) [rad/s]: of each joint, the way that widens the distance by self-motion.

        `null` (r, n) has orthonormal rows that span the self-motions.
        """
        size = size_of(near.distances.least, self._law)
        if size <= 0.0:
            return np.zeros(len(self._joints))
        # Joint i alone, projected, widens the distance at (P slope)_i.
        widening = (null @ near.distances.slope) @ null
        return np.asarray(size * self._joints * np.clip(widening / LEVEL, -1.0, 1.0))


def size_of(distance: float, law: PrioritySection) -> float:
    """Return |ξ| of each joint [rad/s] at a distance [m] (eq. 8)."""
    part = (law.outer_radius - distance) / (law.outer_radius - law.inner_radius)
    return law.rate * max(0.0, part)


def alpha_of(distance: float, law: PrioritySection) -> float:
    """Return α at a distance [m] (eq. 9)."""
    part = (distance - law.inner_radius) / (law.outer_radius - law.inner_radius)
    return math.exp(-law.steepness * max(0.0, part))


# --- The potential field of one cell's arm, as the tick uses it -----------------------------------

GIVE_WAY_GAIN = 4.0
"""How quickly the virtual link follows the field [1/s]."""

FLATTEST = 0.02
"""Where the field bends less than this part of its strength, it counts as so much [1/rad²]."""

ON_PATH = 1e-3
"""A virtual link shorter than this is none: the tool is on its path [m]."""

_NO_LINKS = np.zeros((0, 2, 3))
NO_DIRECTIONS = np.zeros((0, 3))
"""Of no virtual links."""
_UPRIGHT = 0.999
"""A path whose direction has more of World's z than this is vertical [1]."""
_BESIDE = 1e-6
"""A tool is on its virtual links within this [m]."""


class LinkState(NamedTuple):
    """The virtual links in effect."""

    links: VirtualLinks
    share: float = 1.0
    """Part of what they ask of the tool that it does: less while they change."""

    def changed(self, told: VirtualLinks, step: float) -> "LinkState":
        """Return it a period later; `told` is how the links are to be.

        Their motion fades by `step`, and once it is gone that of the others begins.
        """
        if told == self.links:
            return self if self.share == 1.0 else LinkState(told, min(1.0, self.share + step))
        share = max(0.0, self.share - step)
        return LinkState(self.links if share > 0.0 else told, share)


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
        self.search = c.search
        """Steps of the search for the least potential in a tick [1]; 0: none."""
        body = np.zeros(0, dtype=np.int64) if capsules is None else capsules.body
        k = Strengths(c.obstacles, c.lines, c.joint_limits, c.manipulability)
        smooth = c.line_model == "smooth"
        potential = Potential(joints.lower, joints.upper, body, k, c.least_distance, smooth, rank)
        self.flow = FieldFlow(potential, body, max(FLATTEST * max(k), 1e-9))
        link = c.virtual_link
        self._repels = capsules is not None and (k.obstacles > 0.0 or k.lines > 0.0)
        self._always = k.joint_limits > 0.0 or k.manipulability > 0.0 or link is not None
        """Something is felt without obstacles too."""
        self.links = None if link is None else VirtualLinks.of(link)
        """Those of the cell file; None without any."""
        # Scratch: the directions seen last, and their unit vectors.
        self._directions: tuple[object, Array] = ((), NO_DIRECTIONS)

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
        among, ends = self._among(scene), _NO_LINKS
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

    def directions(self, links: VirtualLinks, R_mrf: Array, R_crf: Array, way: Array) -> Array:
        """Return where virtual links point (k, 3), unit vectors in World.

        MRF and CRF stand at `R` (3, 3); a straight path goes a `way` (3,) [m], zeros for none.
        """
        if links.directions is not self._directions[0]:
            each = [np.array(d) / math.hypot(*d) for d in links.directions]
            self._directions = links.directions, np.array(each).reshape(-1, 3)
        told = self._directions[1]
        match links.axes:
            case "mrf":
                return told @ R_mrf.T
            case "crf":
                return told @ R_crf.T
            case "path" if float(way @ way) > ON_PATH**2:
                return told @ path_axes(way)
        return told

    def give_way(
        self,
        seen: FieldView | None,
        state: LinkState,
        off_path: Array | None,
        led: bool,
        factor: float,
        directions: Array,
    ) -> Array | None:
        """Return the velocity (3,) [m/s] at which the tool leaves its path, or comes back.

        `off_path` (3,) is where it is off its path now [m], `led` tells whether a goal leads it,
        `factor` is the reduced-speed setting, `directions` (k, 3) are those of the links in effect.
        What links that turned have left behind is taken back. None where there is no path to leave.
        """
        link, (links, share) = self._link, state
        if link is None or seen is None or not (led or links.always):
            return None
        most, velocity, left = factor * link.speed, np.zeros(3), off_path
        for direction in directions:
            d = 0.0 if off_path is None else float(off_path @ direction)
            speed = GIVE_WAY_GAIN * self.flow.along(seen, direction, d, links.stiffness)
            # Towards either end no faster than it can be stopped before.
            low = max(-most, GIVE_WAY_GAIN * (-link.longest - d))
            high = min(most, GIVE_WAY_GAIN * (link.longest - d))
            velocity += min(high, max(low, speed)) * direction
            left = None if left is None else left - d * direction
        beside = 0.0 if left is None else math.sqrt(float(left @ left))
        if left is None or beside < _BESIDE:
            return share * velocity
        return np.asarray(share * (velocity - min(GIVE_WAY_GAIN, most / beside) * left))

    def _among(self, scene: Scene | None) -> Scene | None:
        """Return what repels the links; None if nothing does."""
        return scene if scene is not None and self._repels and scene.names else None


def path_axes(way: Array) -> Array:
    """Return the axes of a straight path that goes a way (3,) [m], as rows (3, 3) in World.

    x is along it, z square to it and nearest to World's z, or to World's x on a vertical path.
    """
    x = way / math.sqrt(float(way @ way))
    up = np.array([0.0, 0.0, 1.0]) if abs(x[2]) < _UPRIGHT else np.array([1.0, 0.0, 0.0])
    z = up - float(x @ up) * x
    z /= math.sqrt(float(z @ z))
    return np.array([x, np.cross(z, x), z])


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
