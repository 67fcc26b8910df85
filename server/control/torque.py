"""Computed torque in the tool's space, with the null space of equal inertia, for drives in CST.

    q̈* = q̈_0 + J̄ (ẍ* − J q̈_0),   q̈_0 = q̈_c + K_v (q̇_c − q̇) + K_n (q_c − q)
    ẍ* = ẍ_c + K_d (ẋ_c − ẋ) + K_p (x_c − x) − J̇ q̇,   τ = M q̈* + h − Jᵀ F − r

with `J̄ = M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹`: eq. 6 of Hamaguchi and Taniguchi, whose self-motion is not left to
itself, F the *measured* force on the arm and r what the momentum observer found beside it. Where
the tool cannot move, damping takes J̄ away and the joints' own law is what is left.

A torque that is computed from what SYNC k sampled acts from SYNC k + 1 to k + 2: the state is
predicted to k + 1 with the torque that acts until then.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...config.torque import Torque
from .compiled import MATRIX, NUMBER, VECTOR, compiled
from .dynamics import Dynamics
from .frames import Array, Pose, pose_error
from .momentum import MomentumState, begin, corrected, observe
from .trajectory import Motion


class TorqueState(NamedTuple):
    """What the law remembers of the last tick."""

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


class Torques(NamedTuple):
    """Torques (n,) [N·m], and joints whose disturbance is beyond what may be compensated."""

    tau: Array
    beyond: NDArray[np.bool_]


class TorqueLaw:
    """The law of one arm; all arrays (n,)."""

    def __init__(
        self,
        dynamics: Dynamics,
        torque: Torque,
        friction: Array,
        max_torque: Array,
        length: float,
        period_s: float,
    ) -> None:
        """Build; `length` weighs radians against metres where the tool's mobility is judged [m].

        `friction` is Coulomb's at the joints, fed forward where motion is commanded [N·m].
        """
        self._dynamics = dynamics
        self._gains = torque
        self._friction = friction
        self._authority = torque.observer_share * max_torque
        self._T = period_s
        self._trust = 1.0 - math.exp(-2.0 * math.pi * torque.velocity_filter_hz * period_s)
        self._weight = np.array([1.0] * 3 + [length] * 3)

    def step(
        self,
        state: TorqueState | None,
        q: Array,
        before: Motion,
        after: Motion,
        wrench_on_arm: Array | None,
        T_wrist_mrf: Pose,
        time_s: float,
        settled: bool,
    ) -> tuple[TorqueState, Torques]:
        """Return what to remember, and the torques to send.

        `q` (n,) was sampled at the last SYNC; the command goes from `before` to `after` while the
        torque acts. `wrench_on_arm` (6,) is measured, at and in the MRF. `settled` is true while
        the drives are off: nothing is suspected then.
        """
        T = self._T
        if state is None or not 0.5 * T < time_s - state.time_s < 1.5 * T:
            state = self._restart(q, time_s)
        rate = (q - state.q) / T  # in the middle of the period that has passed
        terms = self._dynamics.terms(q, rate)
        inverse = np.asarray(np.linalg.inv(terms.M), dtype=np.float64)
        k = self._dynamics.kinematics(q, T_wrist_mrf)
        felt = np.zeros_like(q)
        if wrench_on_arm is not None:
            R = k.T_world_mrf.R
            wrench = np.concatenate([R @ wrench_on_arm[:3], R @ wrench_on_arm[3:]])
            felt = k.J.T @ wrench
        h = self._dynamics.bias(q, rate)
        beside = felt + state.momentum.residual - h
        # The rate now: the encoders' own, half a period old, carried on by what acted since.
        dq = rate + 0.5 * T * (inverse @ (state.sent[1] + beside))
        dq = state.dq_next + self._trust * (dq - state.dq_next)
        known = state.sent[1] + terms.drift + felt
        momentum = observe(state.momentum, terms.M @ dq, known, self._gains.observer, T)
        if settled:
            momentum = begin(terms.M @ dq)
        else:
            momentum = self._without_stiction(momentum, terms.M @ dq, q, before, after)
        ddq = inverse @ (state.sent[0] + felt + momentum.residual - h)
        q_next, dq_next = q + T * (dq + 0.5 * T * ddq), dq + T * ddq
        ddq = self._wanted(q_next, dq_next, before, after, inverse, T_wrist_mrf)
        found = momentum.residual
        unknown = np.clip(found, -self._authority, self._authority)
        tau = terms.M @ ddq + self._dynamics.bias(q_next, dq_next) - unknown
        tau = tau - self._gains.compensation * felt
        rubbing = self._friction * np.tanh(self._heading(q_next, before, after))
        sent = tau + rubbing
        kept = TorqueState(q, dq_next, (tau, state.sent[0]), sent, momentum, time_s)
        return kept, Torques(sent, np.abs(found) > self._authority)

    def _without_stiction(
        self, state: MomentumState, momentum: Array, q: Array, before: Motion, after: Motion
    ) -> MomentumState:
        """Return the observer's state without what friction alone may hold of a standing joint.

        Learnt at rest, it would be in the way when the joint sets off: friction turns round then.
        """
        # The fourth power: a joint that creeps is not standing, and what is learnt there counts.
        standing = (1.0 - np.abs(np.tanh(self._heading(q, before, after)))) ** 4
        band = self._friction * standing
        residual = state.residual - np.clip(state.residual, -band, band)
        return corrected(momentum, residual, self._gains.observer)

    def _heading(self, q: Array, before: Motion, after: Motion) -> Array:
        """Return where each joint is to go (n,), in terms of the speed that friction is full at."""
        g = self._gains
        return np.asarray((after.dq + g.friction_lead * (before.q - q)) / g.friction_speed)

    def _restart(self, q: Array, time_s: float) -> TorqueState:
        """Return the state of an arm that was not looked at before: at rest, and held."""
        rest = np.zeros_like(q)
        held = self._dynamics.bias(q, rest)
        return TorqueState(q, rest, (held, held), held, begin(rest), time_s - self._T)

    def _wanted(
        self, q: Array, dq: Array, before: Motion, after: Motion, inverse: Array, T_wrist_mrf: Pose
    ) -> Array:
        """Return joint accelerations (n,) that bring tool and joints to the command."""
        g = self._gains
        commanded, drift_c = self._dynamics.tool(before.q, before.dq, T_wrist_mrf)
        actual, drift = self._dynamics.tool(q, dq, T_wrist_mrf)
        ahead = (after.dq - before.dq) / self._T
        own = ahead + g.null_damping * (before.dq - dq) + g.null_stiffness * (before.q - q)
        error = pose_error(commanded.T_world_mrf, actual.T_world_mrf)
        tool, mobility = _asked(
            commanded.J, actual.J, ahead, before.dq, dq, own, drift_c - drift, error,
            g.damping, g.stiffness, inverse, self._weight,
        )  # fmt: skip
        values, axes = np.linalg.eigh(mobility)
        return _answered(
            own, tool, actual.J, inverse, self._weight, values, axes,
            g.singular_region, g.singular_damping,
        )  # fmt: skip


@compiled(
    MATRIX, MATRIX, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, NUMBER, NUMBER, MATRIX, VECTOR
)
def _asked(
    J_c: Array, J: Array, ahead: Array, dq_c: Array, dq: Array, own: Array, drift: Array,
    error: Array, damping: float, stiffness: float, inverse: Array, weight: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Return what the tool's acceleration (6,) lacks beside the joints', and its mobility (6, 6).

    Both weighted. `_c` is the command's; `drift` (6,) and `error` (6,) are its differences to the
    arm; the mobility is `J M⁻¹ Jᵀ`.
    """
    n = len(own)
    tool, mobility, moved = np.empty(6), np.zeros((6, 6)), np.zeros((6, n))
    for i in range(6):
        a = drift[i] + stiffness * error[i]
        for j in range(n):
            a += J_c[i, j] * (ahead[j] + damping * dq_c[j])
            a -= J[i, j] * (own[j] + damping * dq[j])
            for k in range(n):
                moved[i, j] += J[i, k] * inverse[k, j]
        tool[i] = weight[i] * a
    for i in range(6):
        for k in range(6):
            for j in range(n):
                mobility[i, k] += weight[i] * moved[i, j] * J[k, j] * weight[k]
    return tool, mobility


@compiled(VECTOR, VECTOR, MATRIX, MATRIX, VECTOR, VECTOR, MATRIX, NUMBER, NUMBER)
def _answered(
    own: Array, tool: Array, J: Array, inverse: Array, weight: Array, mobility: Array, axes: Array,
    region: float, damping: float,
) -> Array:  # fmt: skip
    """Return the joints' accelerations (n,): their own, and those that give the tool its own.

    The tool's mobility is inverted along each of its `axes`, damped where it is below `region`.
    """
    n = len(own)
    pushed = np.zeros(n)
    for m in range(6):
        short = max(0.0, 1.0 - max(mobility[m], 0.0) / region)
        part = 0.0
        for i in range(6):
            part += axes[i, m] * tool[i]
        part *= mobility[m] / (mobility[m] ** 2 + (damping * short) ** 2)
        for j in range(n):
            for i in range(6):
                pushed[j] += J[i, j] * weight[i] * axes[i, m] * part
    out = own.copy()
    for j in range(n):
        for k in range(n):
            out[j] += inverse[j, k] * pushed[k]
    return out
