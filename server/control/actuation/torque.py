"""Torque setpoints of drives in CST: the computed torque, with measured and observed forces.

    τ = M q̈* + h − Jᵀ F − r

with M q̈* + h of `computed_torque.py`, F the *measured* force on the arm, as far as it is believed
(`believed.py`), and r what the momentum observer (`momentum.py`) found beside it.

A torque that is computed from what SYNC k sampled acts from SYNC k + 1 to k + 2: the state is
predicted to k + 1 with the torque that acts until then. M and h are those of the declared payload.

The law asks for no more than the motors may give and change by in a period: each joint goes as far
towards its torque as its bounds let it. The prediction and the observer know what was sent, so that
what was held back is no disturbance, and nothing winds up. A force that changes is answered as far
as a declared load that is not there leaves the arm at rest (`load_doubt.py`).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....config.schema.mechanism.torque import TorqueSection
from ..compiled import VECTOR, compiled
from ..mechanism.dynamics import Dynamics
from ..mechanism.kinematics import Kinematics
from ..rigid_body import jacobian_at, wrench_to
from ..spatial import Array, Pose, pose_error
from ..stop.motion import Motion
from .believed import (
    NOTHING_LEFT_OUT,
    Believed,
    believed,
    may_be_weight,
    without_what_is_there,
)
from .computed_torque import computed_torque
from .load_doubt import LASTS_HZ, held_back, share_at_once
from .momentum import MomentumState, begin, foreseen

_NONE = np.zeros(6)

STANDS = 1e-3
"""Joints that move at most so fast are held by their brakes [rad/s]."""


class TorqueState(NamedTuple):
    """Memory of the law from the last tick."""

    q: Array
    """Joints as measured (n,) [rad]."""
    dq_next: Array
    """Their rates as predicted for the next SYNC (n,) [rad/s]."""
    sent: tuple[Array, Array]
    """The last two torques (n,), newest first, without what was fed forward against friction."""
    tau: Array
    """The last torque (n,) as it was sent [N·m]."""
    momentum: MomentumState
    time_s: float
    lasting: Array | None = None
    """Lasting part of the wrench (6,) on the arm, at and in the Wrist [N, N·m]; None at first."""
    believed: Believed = NOTHING_LEFT_OUT
    """The part of the measured wrench that is left out."""


class Torques(NamedTuple):
    """Torques (n,) [N·m], and joints of which there is something to tell."""

    tau: Array
    beyond: NDArray[np.bool_]
    """Joints (n,) whose disturbance is beyond what may be compensated."""
    held_back: NDArray[np.bool_]
    """Joints (n,) that would have been given more, but for the bounds of torque and its rate."""


class TorqueLaw:
    """The law of one arm; all arrays (n,)."""

    def __init__(
        self,
        dynamics: Dynamics,
        torque: TorqueSection,
        friction: Array,
        max_torque: Array,
        length: float,
        period_s: float,
        max_torque_rate: Array | None = None,
        T_wrist_tool: Pose | None = None,
        rated_payload: float = math.inf,
    ) -> None:
        """Build; `length` weighs radians against metres where the tool's mobility is judged [m].

        The tool is led at `T_wrist_tool`, the Wrist itself when None, wherever the MRF is; no load
        is heavier than `rated_payload` [kg].
        `friction` is Coulomb's at the joints, fed forward where motion is commanded [N·m].
        `max_torque_rate` [N·m/s] is unbounded when None.
        """
        self._dynamics = dynamics
        self._T_wrist_tool = Pose.identity() if T_wrist_tool is None else T_wrist_tool
        self._rated, outboard = rated_payload, self._T_wrist_tool.p - dynamics.sensor_at
        self._outboard = outboard / max(float(np.linalg.norm(outboard)), 1e-9)
        self._gains = torque
        self._friction = friction
        self._authority = torque.observer_share * max_torque
        self._most = max_torque
        rate = np.inf if max_torque_rate is None else max_torque_rate
        self._step = np.broadcast_to(rate * period_s, max_torque.shape).astype(float)
        self._anywhere = np.full(max_torque.shape, np.inf)
        self._T = period_s
        self._trust = 1.0 - math.exp(-2.0 * math.pi * torque.velocity_filter_hz * period_s)
        self._lasts = 1.0 - math.exp(-2.0 * math.pi * LASTS_HZ * period_s)
        self._weight = np.array([1.0] * 3 + [length] * 3)

    def step(
        self,
        state: TorqueState | None,
        q: Array,
        before: Motion,
        after: Motion,
        commanded: Kinematics,
        wrench_on_arm: Array | None,
        T_wrist_mrf: Pose,
        time_s: float,
        settled: bool,
        offset: Array = _NONE,
    ) -> tuple[TorqueState, Torques]:
        """Return what to remember, and the torques to send.

        `q` (n,) was sampled at the last SYNC; the command goes from `before`, where the arm is as
        `commanded`, to `after` while the torque acts. `wrench_on_arm` (6,) is measured, at and in
        the MRF; `offset` (6,) was taken off it as the sensor's bias, at and in the Wrist. `settled`
        is true while the drives are off: nothing is suspected then.
        """
        T, g = self._T, self._gains
        last, step = (q, self._anywhere) if state is None else (state.tau, self._step)
        if state is None or not 0.5 * T < time_s - state.time_s < 1.5 * T:
            state = self._restart(q, time_s, NOTHING_LEFT_OUT if state is None else state.believed)
        rate = (q - state.q) / T  # in the middle of the period that has passed
        terms = self._dynamics.terms(q, rate)
        felt = None if wrench_on_arm is None else wrench_to(T_wrist_mrf, wrench_on_arm)
        known = self._believed(state, q, rate, felt, offset, terms.J_wrist, settled)
        felt = _NONE if felt is None else felt - known.left_out
        then = foreseen(
            terms.M, terms.C, terms.g, terms.J_wrist, felt, known.left_out,
            q, rate, state.dq_next, *state.sent, *state.momentum,
            before.q, after.dq, self._friction, self._authority,
            T, self._trust, g.observer, g.friction_lead, g.friction_speed,
            g.compensation, settled,
        )  # fmt: skip
        lasting = felt if state.lasting is None else state.lasting
        lasting = lasting + self._lasts * (felt - lasting)
        mass, at = self._dynamics.carried
        share, answer = share_at_once(then.inverse, terms.J_wrist, at, mass), then.answer
        if share < 1.0:
            answer = answer + g.compensation * held_back(terms.J_wrist, felt, lasting, share)
        T_world_tool, J_tool = self._at_tool(commanded)
        actual = self._dynamics.kinematics(then.q, self._T_wrist_tool)
        error = pose_error(T_world_tool, actual.T_world_mrf)
        tau = computed_torque(
            terms.M, self._dynamics.bias(then.q, then.dq), answer,
            then.inverse, J_tool, actual.J, error,
            before.q, before.dq, after.dq, then.q, then.dq, self._weight,
            T, g.damping, g.stiffness, g.null_damping, g.null_stiffness,
            g.singular_region, g.singular_damping,
        )  # fmt: skip
        sent, short = within_reach(tau + then.rubbing, last, self._most, step)
        tau = sent - then.rubbing
        momentum = MomentumState(then.expected, then.residual)
        kept = TorqueState(q, then.dq, (tau, state.sent[0]), sent, momentum, time_s, lasting, known)
        return kept, Torques(sent, then.beyond, short)

    def carry(self, mass: float, com: Array) -> None:
        """Say what is outboard of the Sensor frame: a point mass [kg] at com (3,) [m] in it."""
        self._dynamics.carry(mass, com)

    def _at_tool(self, k: Kinematics) -> tuple[Pose, Array]:
        """Return the pose and the Jacobian (6, n) of the tool, from those of the MRF.

        With a far MRF, a turn of the tool would be a way of metres to the law's stiffness.
        """
        T = k.T_world_wrist @ self._T_wrist_tool
        lever = T.p - k.T_world_mrf.p
        return T, jacobian_at(k.J, lever) if np.count_nonzero(lever) > 0 else k.J

    def _believed(
        self,
        state: TorqueState,
        q: Array,
        rate: Array,
        wrench: Array | None,
        offset: Array,
        J: Array,
        settled: bool,
    ) -> Believed:
        """Return what of a measured wrench (6,) is left out."""
        before, weight, standing = state.believed, True, False
        if settled and before.driven:
            before = without_what_is_there(before, J, state.momentum.residual)
        if settled and not before.judged and wrench is not None:
            mass, _ = self._dynamics.carried
            at_sensor = wrench_to(Pose(np.eye(3), -self._dynamics.sensor_at), wrench)
            down = self._dynamics.down(q)
            weight = may_be_weight(at_sensor, down, self._outboard, mass, self._rated)
            standing = float(np.abs(rate).max()) <= STANDS
        return believed(before, wrench, offset, weight, settled, standing, self._lasts)

    def _restart(self, q: Array, time_s: float, known: Believed) -> TorqueState:
        """Return the state of an arm that was not looked at before: at rest, and held."""
        rest = np.zeros_like(q)
        held = self._dynamics.bias(q, rest)
        momentum = begin(rest)
        return TorqueState(q, rest, (held, held), held, momentum, time_s - self._T, None, known)


@compiled(VECTOR, VECTOR, VECTOR, VECTOR)
def within_reach(
    wanted: Array, last: Array, most: Array, step: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the torques (n,) nearest to those `wanted` that may follow on the `last` ones [N·m].

    Each is at most `most` (n,), and at most `step` (n,) from the last one, which itself may be
    beyond. Also returns which of them (n,) are not as wanted. What is not a number stays.
    """
    out, held_back = np.empty(len(wanted)), np.zeros(len(wanted), dtype=np.bool_)
    for j in range(len(wanted)):
        low, high = max(-most[j], last[j] - step[j]), min(most[j], last[j] + step[j])
        out[j] = wanted[j]
        if wanted[j] > high:
            out[j], held_back[j] = high, True
        elif wanted[j] < low:
            out[j], held_back[j] = low, True
    return out, held_back
