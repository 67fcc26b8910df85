"""Joint rates of an arm on a base that rolls: one redundant mechanism of wheels and arm.

Zhang et al. 2013, eqs. 7 and 8, weighted: η = J_W⁺ ẋ + P z with ẋ = ẋ_d + K (x_d − x), in which the
error is added (in print its sign is wrong). With D the wheels' share of work, J_W⁺ = D (J D)⁺, and
P = 1 − J_W⁺ J, an oblique projector. D is 1 for the arm; for the wheels it goes from 0, where the
arm works alone, to the cell's `weight`.

Relative to Base the arm works alone, and the base goes as it is driven. Relative to World an
operator's drive is z, which the arm answers, so that the tool stands or goes on as asked while the
base drives past below. Without a drive the base follows a tool that is asked to go.
"""

from typing import NamedTuple

import numpy as np

from .....config.schema.cell import ResolveSection
from .....config.schema.mechanism.base import DifferentialBaseSection
from ...joints import Joints
from ...rigid_body import jacobian_at, twist_at
from ...spatial import Array, Pose, sizes
from ...wheels.rolling import Rolling
from ..joint_rates import Around, JointRates, Wish
from ..kinematics import Kinematics
from ..null_space.potential_field import Field, shifted
from ..null_space.priority import Priority
from ..null_space.redundancy import Redundancy
from ..resolution import Resolved, resolve
from ..singularity import Travel

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
