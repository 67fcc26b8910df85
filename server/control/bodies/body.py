"""What a kind of body does in its own way, and a serial arm whose foot stands.

Tick, units, perception and telemetry ask a body, and never which kind it is. A new kind overrides
what it does otherwise, and gets its row in `arm.py`.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from ....config.load import Cell
from ..axes import HeldAxes
from ..inputs import DriveRequest, Settings, ToldTunnel
from ..mechanism.model import Mechanism
from ..mechanism.objectives import View
from ..mechanism.potentials import FieldView
from ..mechanism.redundancy import NO_DIRECTIONS, Field, Redundancy, shifted
from ..mechanism.resolution import Resolved, Travel, resolve
from ..mechanism.self_motion import IDLE, SelfMotionByHand
from ..parameters import Parameters
from ..spatial import Array, Kinematics, Pose, jacobian_at, nonzero, pose_error, twist_at
from ..stop.limiter import StopConstraint
from .rates import NO_LEVER, ArmTick, Insertion, JointRates

# --- Joint rates of a twist, and what spare joints do beside --------------------------------------
#
# It knows no sources: one twist goes in, whoever asked for it. Joints may share the work unequally
# (Zhang et al. 2013, eq. 8, weighted): with D their shares, J_W⁺ = D (J D)⁺, and P = 1 − J_W⁺ J is
# an oblique projector.


MOST_AHEAD_S: Final = 0.5
"""The search for the least potential begins where the task leads in no more than this [s]."""
MOST_STEP: Final = 0.2
"""Of a joint, in one step of the search [rad]."""


class Shares(NamedTuple):
    """How the joints share the work of a twist."""

    rank: int
    """So many axes are reached anywhere."""
    D: Array | None = None
    """The shares (n,) [1]; None: 1 each."""


class Resolver:
    """Turns twists of one mechanism's tool into joint rates."""

    def __init__(
        self,
        p: Parameters,
        redundancy: Redundancy,
        field: Field,
        mechanism: Mechanism,
        own: Array | None = None,
    ) -> None:
        """Build it.

        `own` (n,) is 1 for joints of whose motion redundancy objectives know, and 0 for others;
        None: they know of all.
        """
        self._lower, self._upper, self._section = p.joints.lower, p.joints.upper, p.resolve
        self._redundancy, self._field, self._priority = redundancy, field, p.priority
        self._even, self._own, self._mechanism = Shares(mechanism.rank), own, mechanism
        self.by_hand = SelfMotionByHand(
            p.joints,
            mechanism,
            p.redundancy.max_rate * p.joints.velocity,
            p.redundancy.arm_angle_speed,
            p.resolve.characteristic_length,
            p.period_s,
            own,
        )
        self._weighs, self._payload = p.T_wrist_sensor is not None, p.payload

    def none(self, dq: Array) -> JointRates:
        """Return joint rates (n,) that nothing was resolved for."""
        return JointRates(dq, self._redundancy.none())

    def rates(
        self,
        request: ArmTick,
        shares: Shares | None = None,
        whole: bool = False,
    ) -> JointRates:
        """Return joint rates at the commanded posture.

        `whole`: objectives look at the tool as all joints move it, not at their own joints alone.
        """
        spare, view, inputs, held = request.spare, None, request.inputs, request.held
        q = request.commanded.motion.q
        shares = self._even if shares is None else shares
        if held is not None and shares is self._even:
            shares = Shares(held.rank)
        k, D = judged_at(request.kinematics, request.lever), shares.D
        factor = inputs.settings.speed_factor
        if spare:
            view = self._field.look(
                q, k, inputs.scene, request.objectives, request.T_world_base, request.placed, held
            )
        give_way, links = None, NO_DIRECTIONS
        if (state := request.links) is not None:
            R_mrf, R_crf = k.T_world_mrf.R, inputs.settings.T_world_crf.R
            links = self._field.directions(state.links, R_mrf, R_crf, request.way)
            led = inputs.goal is not None
            give_way = self._field.give_way(view, state, request.off_path, led, factor, links)
        task = self.resolve(q, k.J, shifted(request.asked, give_way), request.lever, shares, held)
        dq, self_motion, felt = task.dq, self._redundancy.none(), None
        if spare:
            plain, J = task.null, k.J if self._own is None or whole else self._own * k.J
            near = None if self._priority is None else request.near
            if view is not None or near is not None:
                plain = _spanned(task.null, D)
            downhill, felt = self._field.self_motion(view, plain)
            if view is not None and self._field.search:
                downhill = self._searched(request, view, task.dq, shares)
            outside = {} if downhill is None else {"field": downhill}
            if self._priority is not None and near is not None:
                outside["spheres"] = self._priority.rates(near, plain)
            posture, length = request.objectives.posture, self._section.characteristic_length
            payload = (inputs.settings.payload or self._payload) if self._weighs else None
            at = View(q, J, dq, task.null, posture, outside, payload, length, held)
            self_motion = self._redundancy.rate(at, request.objectives, factor, D, self._own)
            dq = dq + self_motion.dq
        limits = ("singularity",) if task.singular else ()
        by_hand = request.by_hand if request.moving else IDLE
        found = JointRates(
            dq, self_motion, task.sigma_min, limits, felt, give_way, links, by_hand=by_hand
        )
        return self._led(found, k, task.null, request) if request.led_by_hand else found

    def _searched(self, request: ArmTick, view: FieldView, dq_task: Array, shares: Shares) -> Array:
        """Return the joint rates (n,) to the least potential, at a gain of 1 /s, by a search.

        Scott and Carignan 2008, eqs. 3 to 6: from q_0 = q + dq_task · a time, which the task leads
        to, a fixed number of steps, each Δq = P (−∇V) as long as the slope's curvature has it, with
        the tool brought back by J⁺. Their sum is what the null space takes. Over the time in which
        the field's gain follows, joints then lag behind no least that moves: they depend on where
        the tool is, and not on how it came there (Wang and Kumar 2001).
        """
        settings, scene = request.inputs.settings, request.inputs.scene
        time_s = min(1.0 / request.objectives.gains["field"], MOST_AHEAD_S)
        q = begin = request.commanded.motion.q + time_s * dq_task
        k = aim = self._mechanism.kinematics(q, settings.T_wrist_mrf, request.T_world_base)
        R, held = request.kinematics.T_world_mrf.R, request.held
        for _ in range(self._field.search):
            turned = None if held is None else held.seen(k.T_world_mrf.R @ R.T)
            error = pose_error(aim.T_world_mrf, k.T_world_mrf)
            if turned is not None:
                error = turned.error(error)
            task = self.resolve(q, k.J, error, NO_LEVER, shares, turned)
            there = self._field.look(
                q, k, scene, request.objectives, request.T_world_base, None, turned
            )
            step = self._field.self_motion(there, _spanned(task.null, shares.D))[0]
            if step is not None:
                q = q + step / max(1.0, float(np.abs(step).max()) / MOST_STEP)
            q = np.clip(q + task.dq, self._lower, self._upper)
            k = self._mechanism.kinematics(q, settings.T_wrist_mrf, request.T_world_base)
        return np.asarray(q - begin)

    def _led(self, found: JointRates, k: Kinematics, null: Array, request: ArmTick) -> JointRates:
        """Return joint rates with what an operator asks of the spare joints.

        The more avoiding comes before a hand's force, the less of it.
        """
        asked, factor = request.inputs.self_motion, request.inputs.settings.speed_factor
        share = 1.0 - request.precedence
        answer = self.by_hand.step(
            k, null, asked, request.by_hand, found.dq, factor, share, request.held
        )
        self_motion = found.self_motion._replace(dq=found.self_motion.dq + answer.dq)
        return found._replace(
            dq=found.dq + answer.dq,
            self_motion=self_motion,
            limits=found.limits + answer.limits,
            by_hand=answer.state,
        )

    def resolve(
        self,
        q: Array,
        J: Array,
        twist: Array,
        lever: Array,
        shares: Shares,
        held: HeldAxes | None = None,
    ) -> Resolved:
        """Resolve a twist (6,) of the MRF; J (6, n) is at the point that `lever` leads to."""
        if nonzero(lever):
            twist = twist_at(twist, lever)
        down, up, (rank, D) = q - self._lower, self._upper - q, shares
        if D is None:
            return resolve(J, twist, self._section, Travel(down, up), rank, held)
        task = resolve(J * D, twist, self._section, Travel(down / D, up / D), rank, held)
        return task._replace(dq=D * task.dq)


def _spanned(null: Array, D: Array | None) -> Array:
    """Return orthonormal rows (r, n) of self-motions, given those of joints with shares D (n,)."""
    return null if D is None else np.linalg.qr((null * D).T)[0].T


def judged_at(k: Kinematics, lever: Array) -> Kinematics:
    """Return kinematics at the point of the tool that `lever` (3,) leads to from the MRF [m].

    A new MRF brings no singularity nearer: they are judged at the same point of the tool.
    """
    if not nonzero(lever):
        return k
    there = Pose(k.T_world_mrf.R, k.T_world_mrf.p + lever)
    return Kinematics(k.T_world_wrist, there, jacobian_at(k.J, lever))


# --- Bodies ---------------------------------------------------------------------------------------


class SerialArm:
    """A serial arm whose foot stands; every other kind says what it does otherwise.

    Joints are (n,) [rad], as they are commanded where nothing else is said.
    """

    synchronized: tuple[slice, ...] = ()
    """Joints that stop in proportion, as one."""
    on_curve = False
    """It goes along its curve and nowhere else; so it gives way, too."""

    def __init__(
        self, p: Parameters, mechanism: Mechanism, redundancy: Redundancy, field: Field
    ) -> None:
        """Build it."""
        self._resolver = Resolver(p, redundancy, field, mechanism)
        self.relief = p.joints.acceleration.copy()
        """How much each joint (n,) does of relieving contact."""

    @classmethod
    def builder(cls, cell: Cell) -> "Builder | None":
        """Return what builds the body of a cell's mechanism; None for one of another kind.

        Raises `ConfigError`.
        """
        return cls

    def prepare(self, settings: Settings) -> None:
        """Make ready for a tick with these settings, before it asks for anything else."""

    def refitting(
        self, tunnel: ToldTunnel | None, postures: Callable[[], Sequence[Array]]
    ) -> Iterator[None]:
        """Make ready for a tunnel that an operator tells the arm, a part of a period in each step.

        `postures` returns those (n,) that it is or may come to be in, at the end. Raises
        `ValueError` that says why the arm cannot go through the tunnel, or not from there.
        """
        raise ValueError("the mechanism has no backbone: it goes through no tunnel")

    def rates(self, request: ArmTick) -> JointRates:
        """Return joint rates that do what is asked for."""
        return self._resolver.rates(request)

    @property
    def by_hand(self) -> SelfMotionByHand:
        """What makes joint rates of an operator's self-motion."""
        return self._resolver.by_hand

    def spare(self, insertion: Insertion | None, ranks: tuple[int, int] | None) -> int:
        """Return how many freedoms are an operator's to move while the tool stays.

        `ranks` are those of a task that leaves axes free; None: it holds all.
        """
        return self.by_hand.spare(ranks)

    def with_drive(self, rates: Array, drive: DriveRequest, factor: float) -> Array:
        """Return joint rates (n,) towards a posture, and beside them what an operator drives."""
        return rates

    def posture(self, posture: Array, q: Array) -> Array:
        """Return where joints q are to go for a posture that is asked for: the arm's alone."""
        return posture

    def ahead(self, q: Array) -> float:
        """Return how far joints q take the base ahead [m]; for their rates, how fast [m/s]."""
        return 0.0

    def path(self, k: Kinematics, relative_to_base: bool) -> Array | None:
        """Return the Jacobian (6, n) of the path that barriers spare; None: that of the tool."""
        return None

    def wall_scale(self, tick: ArmTick) -> float:
        """Return the share (0 to 1) of the rates asked for that keeps measured links off walls."""
        return 1.0

    def stop_constraint(self, tick: ArmTick) -> StopConstraint | None:
        """Return what judges stops of the joints; None: nothing of its own."""
        return None

    def arrived(self, insertion: Insertion | None, drive: DriveRequest) -> bool | None:
        """Return whether a drive is where it leads to; None for one that leads nowhere."""
        return None

    def beyond_wall(self, insertion: Insertion | None, q: Array) -> float:
        """Return how far links at joints q stand beyond the walls around them [m]; 0 for not."""
        return 0.0

    def telemetry(self, insertion: Insertion | None) -> dict[str, float] | None:
        """Return where the body is along its curve; None for one that is on none."""
        return None


Builder = Callable[[Parameters, Mechanism, Redundancy, Field], SerialArm]
"""Builds the body of one mechanism."""
