"""The joint rates of one mechanism, on wheels or not: a twist of its tool, what is led beside."""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from ....config.schema.cell import ResolveSection
from ....config.schema.mechanism import DifferentialBaseSection
from ..joints import Joints
from ..proximity.capsules import Placed
from ..scene import Scene
from ..spatial import Array, Pose, jacobian_at, sizes, twist_at
from ..wheels import Rolling
from .field import Field, FieldReading, shifted
from .model import Kinematics
from .redundancy import Near, ObjectiveGains, Priority, Redundancy, SelfMotion
from .resolution import Resolved, Travel, resolve

# --- The joint rates of one mechanism: a twist of its tool, and what its spare joints do beside ---
#
# It knows no sources: one twist goes in, whoever asked for it.


class Wish(NamedTuple):
    """The motion that a mechanism is asked for."""

    twist: Array
    """Of its MRF, World axes (6,) [m/s, rad/s]."""
    lever: Array
    """From the MRF to the point of the tool at which singularities are judged (3,) [m]."""
    objectives: ObjectiveGains
    """Gains of the redundancy objectives."""
    speed_factor: float
    spare: bool
    """Spare joints may move."""
    off_path: Array | None
    """Where the virtual link has the tool off its path, in World (3,) [m]."""
    on_way: bool
    """The tool is led along a path, which the virtual link may let it leave."""


class Around(NamedTuple):
    """Surroundings of a mechanism."""

    scene: Scene | None
    near: Near | None
    """Obstacles near its control points; None in a cell without any."""
    T_world_base: Pose | None
    """Where a Base that moves is; None: Base stands."""
    placed: Placed | None
    """Its capsules at the commanded posture, where they are known already."""
    wrench: Array | None = None
    """Wrench that it exerts, at and in the MRF (6,) [N, N·m]; None where that is not known."""


class JointRates(NamedTuple):
    """Joint rates that do what a mechanism is asked for."""

    dq: Array
    """(n,) [rad/s]."""
    self_motion: SelfMotion
    sigma_min: float
    singular: bool
    """Damping or the bound of a singularity takes something off the twist."""
    field: FieldReading | None
    """The potential field; None where nothing follows it."""
    give_way: Array | None
    """Velocity along the virtual link (3,) [m/s]; None where it does not act."""


class Resolver:
    """Turns twists of one mechanism's tool into joint rates."""

    def __init__(
        self,
        joints: Joints,
        section: ResolveSection,
        rank: int,
        redundancy: Redundancy,
        field: Field,
        priority: Priority | None,
    ) -> None:
        """Build it; `rank` is how many axes the mechanism reaches anywhere."""
        self._joints, self._section, self._rank = joints, section, rank
        self._redundancy, self._field, self._priority = redundancy, field, priority

    def rates(self, q: Array, k: Kinematics, wish: Wish, around: Around) -> JointRates:
        """Return joint rates at the commanded posture q (n,) [rad], whose kinematics are `k`."""
        # A new MRF brings no singularity nearer: they are judged at the same point of the tool.
        lever = wish.lever
        elsewhere = np.count_nonzero(lever) > 0
        if elsewhere:
            there = Pose(k.T_world_mrf.R, k.T_world_mrf.p + lever)
            k = Kinematics(k.T_world_wrist, there, jacobian_at(k.J, lever))
        seen = None
        if wish.spare:
            seen = self._field.look(
                q, k, around.scene, wish.objectives, around.T_world_base, around.placed
            )
        give_way = self._field.give_way(seen, wish.off_path, wish.on_way, wish.speed_factor)
        asked = shifted(wish.twist, give_way)
        task = resolve(
            k.J,
            twist_at(asked, lever) if elsewhere else asked,
            self._section,
            Travel(q - self._joints.lower, self._joints.upper - q),
            self._rank,
        )
        dq, self_motion, felt = task.dq, self._redundancy.none(), None
        if wish.spare:
            downhill, felt = self._field.self_motion(seen, task.null)
            outside = {} if downhill is None else {"field": downhill}
            if self._priority is not None and around.near is not None:
                outside["spheres"] = self._priority.rates(around.near, task.null)
            self_motion = self._redundancy.rate(
                q, k.J, dq, task.null, wish.objectives, wish.speed_factor, outside
            )
            dq = dq + self_motion.dq
        return JointRates(dq, self_motion, task.sigma_min, task.singular, felt, give_way)


# --- Joints that are commanded directly: jogged one by one, led to a posture, or beside the tool
#
# The rates z of joints that fold are both a source's, J z, and a redundancy objective's, the
# rest (`reflex` in either table).

GAIN = 4.0
"""Approach to a posture close to it [1/s]."""

REACHED = 2e-4
"""A posture is reached within this angle of every joint [rad]."""


class JointMotion:
    """Rates of joints that are commanded themselves, in place of a tool motion."""

    def __init__(self, velocity: Array, approach: Callable[[Array], Array]) -> None:
        """Build it for joints with bounds of speed (n,) [rad/s].

        `approach` gives the rates (n,) at which joints can still stop within ways (n,) [rad].
        """
        self._velocity, self._approach = velocity, approach

    def rates(
        self, q: Array, jog: Array | None, posture: Array | None, speed_factor: float
    ) -> Array | None:
        """Return joint rates (n,) at q (n,): the jog's, else a posture's; None for neither.

        Towards a posture all joints go in a straight line, as fast as each can still stop at it.
        """
        if jog is not None:
            return jog
        if posture is None:
            return None
        error = posture - q
        size = np.maximum(np.abs(error), 1e-9)
        fastest = np.minimum(self._approach(size), speed_factor * self._velocity)
        return np.asarray(error * min(GAIN, float((fastest / size).min())))


def at_posture(q: Array, posture: Array) -> bool:
    """Return whether joints at q (n,) have reached a posture (n,)."""
    return bool(np.abs(posture - q).max() < REACHED)


FOLDING: Final = "reflex"
"""Name of what folds an arm, among the sources and the objectives."""


class Fold(NamedTuple):
    """A posture that the arm folds to."""

    posture: Array
    """(n,) [rad]; NaN for joints that it does not concern."""
    speed: float
    """The tool goes at most so quickly [m/s]."""

    def rates(self, q: Array, J: Array, joint_motion: JointMotion, factor: float) -> Array:
        """Return joint rates (n,) from q (n,) to the posture, in proportion.

        J (6, n) is the tool's, `factor` the reduced-speed setting.
        """
        goal = np.where(np.isnan(self.posture), q, self.posture)
        dq = joint_motion.rates(q, None, goal, factor)
        if dq is None:
            return np.zeros(len(q))
        v = float(np.linalg.norm(J[:3] @ dq))
        return dq * min(1.0, factor * self.speed / max(v, 1e-12))


class Beside(NamedTuple):
    """Requests to the joints in one tick."""

    fold: Fold | None = None
    sweep: tuple[int, float] | None = None
    """A joint that sweeps, and its rate [rad/s]."""


NOTHING: Final = Beside()


# --- Joint rates of an arm on a base that rolls: one redundant mechanism of wheels and arm --------
#
# Zhang et al. 2013, eqs. 7 and 8, weighted: η = J_W⁺ ẋ + P z with ẋ = ẋ_d + K (x_d − x), in
# which the error is added (in print its sign is wrong). With D the wheels' share of work, J_W⁺
# = D (J D)⁺, and P = 1 − J_W⁺ J, an oblique projector. D is 1 for the arm; for the wheels it
# goes from 0, where the arm works alone, to the cell's `weight`.
#
# Relative to Base the arm works alone, and the base goes as it is driven. Relative to World an
# operator's drive is z, which the arm answers, so that the tool stands or goes on as asked
# while the base drives past below. Without a drive the base follows a tool that is asked to go.

CREEPS, GOES = 0.005, 0.02
"""A tool that is asked for less than the first is the arm's alone; from the second on the base
follows in full, and in between in part [m/s]."""
STANDING = 1e-6
"""Share of the work of wheels that stand [1]: no division by zero."""
RESIDUE = 1e-9
"""A remainder of a twist below this is rounding [m/s, rad/s]."""
WHEELS = slice(0, 2)
"""Where the wheels are among the joints."""


class Rolls(NamedTuple):
    """Joint rates of base and arm."""

    found: JointRates
    led: bool
    """The wheels go as they are driven: barriers may slow them, together, and nothing else."""


class BaseRates:
    """Turns twists of the tool and an operator's drive into rates of wheels and arm."""

    def __init__(
        self,
        section: DifferentialBaseSection,
        rolling: Rolling,
        joints: Joints,
        resolution: ResolveSection,
        ranks: tuple[int, int],
        redundancy: Redundancy,
        field: Field,
        priority: Priority | None,
    ) -> None:
        """Build it; `ranks` are how many axes the arm reaches anywhere, alone and on its base."""
        self._section, self._rolling, self._joints = section, rolling, joints
        self._resolution, self._ranks = resolution, ranks
        self._redundancy, self._field, self._priority = redundancy, field, priority
        self._arm_only = np.ones(joints.n)
        self._arm_only[WHEELS] = 0.0

    def driven(self, v: float, w: float, factor: float) -> Array:
        """Return the wheels' rates (2,) [rad/s] of a drive, on its arc inside their speed bounds.

        `factor` is the reduced-speed setting.
        """
        rates = self._rolling.wheels(factor * v, factor * w)
        most = factor * self._joints.velocity[WHEELS]
        return np.asarray(rates / max(1.0, float((np.abs(rates) / most).max())))

    def path(self, k: Kinematics, relative_to_base: bool) -> Array:
        """Return the Jacobian (6, n) of what the tool does relative to Base, or to World."""
        return self._arm_only * k.J if relative_to_base else k.J

    def rates(
        self,
        q: Array,
        k: Kinematics,
        wish: Wish,
        around: Around,
        relative_to_base: bool,
        wheels: Array,
    ) -> Rolls:
        """Return rates at the commanded posture q (n,) [rad], whose kinematics are `k`.

        `wheels` (2,) are the rates of the operator's drive [rad/s]; zeros for none.
        """
        lever, twist = wish.lever, wish.twist
        if np.count_nonzero(lever):
            # Singularities are judged at one point of the tool, wherever the MRF is.
            there = Pose(k.T_world_mrf.R, k.T_world_mrf.p + lever)
            k = Kinematics(k.T_world_wrist, there, jacobian_at(k.J, lever))
            twist = twist_at(twist, lever)
        driven = bool(np.count_nonzero(wheels))
        if relative_to_base or driven or not wish.spare:
            share, rank = STANDING, self._ranks[0]
        else:
            v, w = sizes(twist)
            speed = max(v, w * self._resolution.characteristic_length)
            part = min(1.0, max(0.0, (speed - CREEPS) / (GOES - CREEPS)))
            share = max(STANDING, part * self._section.weight)
            rank = self._ranks[1] if part > 0.0 else self._ranks[0]
        if driven and not relative_to_base:
            twist = twist - k.J[:, WHEELS] @ wheels
        led = share == STANDING
        seen = None
        if wish.spare:
            seen = self._field.look(
                q, k, around.scene, wish.objectives, around.T_world_base, around.placed
            )
        give_way = self._field.give_way(seen, wish.off_path, wish.on_way, wish.speed_factor)
        twist = shifted(twist, give_way)
        scale = self._scale(share)
        task = self._resolve(k.J, twist, q, scale, rank)
        dq, self_motion, felt = scale * task.dq, self._redundancy.none(), None
        if wish.spare:
            plain, outside = None, {}
            if seen is not None or around.near is not None:
                plain = np.linalg.qr((task.null * scale).T)[0].T
            downhill = None
            if plain is not None:
                downhill, felt = self._field.self_motion(seen, plain)
            if downhill is not None:
                outside["field"] = downhill
            if self._priority is not None and around.near is not None and plain is not None:
                outside["spheres"] = self._priority.rates(around.near, plain)
            self_motion = self._redundancy.rate(
                q, self._arm_only * k.J, dq, task.null, wish.objectives, wish.speed_factor,
                outside, scale,
            )  # fmt: skip
            dq = dq + self_motion.dq
        singular = task.singular
        if led:
            dq[WHEELS] = 0.0
            left = twist - k.J @ dq
            dq[WHEELS] = wheels
            if driven and not relative_to_base and float(np.abs(left).max()) > RESIDUE:
                # The arm cannot answer the drive: the base goes no further than the tool allows.
                scale = self._scale(self._section.weight)
                rest = self._resolve(k.J, left, q, scale, self._ranks[1])
                dq, singular, led = dq + scale * rest.dq, True, False
        found = JointRates(dq, self_motion, task.sigma_min, singular, felt, give_way)
        return Rolls(found, led)

    def _scale(self, share: float) -> Array:
        """Return D (n,): the shares of the joints in the work."""
        scale = np.ones(self._joints.n)
        scale[WHEELS] = share
        return scale

    def _resolve(self, J: Array, twist: Array, q: Array, scale: Array, rank: int) -> Resolved:
        """Resolve a twist (6,) among joints that share the work as `scale` (n,) says.

        The rates are to be multiplied by that.
        """
        lower, upper = self._joints.lower, self._joints.upper
        travel = Travel((q - lower) / scale, (upper - q) / scale)
        return resolve(J * scale, twist, self._resolution, travel, rank)
