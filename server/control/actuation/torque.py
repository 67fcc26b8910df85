"""Torque setpoints of drives in CST: the computed torque, with measured and observed forces."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....config.schema.mechanism import TorqueSection
from ..compiled import MATRIX, NUMBER, VECTOR, compiled, inner_kernel
from ..mechanism.model import Dynamics
from ..spatial import (
    Array,
    Kinematics,
    Motion,
    Pose,
    jacobian_at,
    nonzero,
    pose_error,
    wrench_to,
)
from .believed import (
    NOTHING_LEFT_OUT,
    Believed,
    believed,
    may_be_weight,
    without_what_is_there,
)
from .momentum import MomentumState, begin, predict

# --- Computed torque in the tool's space, with the null space of equal inertia --------------------
#
# q̈* = q̈_0 + J̄ (ẍ* − J q̈_0),   q̈_0 = q̈_c + K_v (q̇_c − q̇) + K_n (q_c − q)
#     ẍ* = ẍ_c + K_d (ẋ_c − ẋ) + K_p (x_c − x) − J̇ q̇,   τ = M q̈* + h + what is given beside
#
# with `J̄ = M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹`: eq. 6 of Hamaguchi and Taniguchi, whose self-motion is not
# left to itself. Where the tool cannot move, damping takes J̄ away and the joints' own law is
# what is left.

SWEEPS = 30
"""At most so many times Jacobi's rotations go over a matrix; six of them are usual."""

ROUNDING = 1e-30
"""Off-diagonal entries below this are rounding: sum of squares against the diagonal's [1]."""


@inner_kernel
def drift(J: Array, dq: Array) -> Array:
    """Return J̇ dq (6,): the tool's acceleration at constant joint rates [m/s², rad/s²].

    Of a chain with Jacobian J (6, n) at rates dq (n,): what a joint does to the tool is turned by
    the joints inboard of it and by itself, what those inboard do is stretched as much.
    """
    out = np.zeros(6)
    wx, wy, wz = 0.0, 0.0, 0.0  # how the joints inboard turn
    for j in range(len(dq)):
        vx, vy, vz = dq[j] * J[0, j], dq[j] * J[1, j], dq[j] * J[2, j]
        x, y, z = dq[j] * J[3, j], dq[j] * J[4, j], dq[j] * J[5, j]
        ax, ay, az = 2.0 * wx + x, 2.0 * wy + y, 2.0 * wz + z
        out[0] += ay * vz - az * vy
        out[1] += az * vx - ax * vz
        out[2] += ax * vy - ay * vx
        out[3] += wy * z - wz * y
        out[4] += wz * x - wx * z
        out[5] += wx * y - wy * x
        wx, wy, wz = wx + x, wy + y, wz + z
    return out


@inner_kernel
def damped(mobility: Array, wanted: Array, region: float, damping: float) -> Array:
    """Return the push (m,) that gives what a symmetric mobility (m, m) lets move as is `wanted`.

    Along an axis of mobility λ it is λ / (λ² + s²) of what is wanted (m,), with
    `s = damping · max(0, 1 − λ / region)`. The axes are found by Jacobi's rotations (Golub and
    Van Loan 2013, 8.5), which turn the matrix and what is wanted alike, and are then undone.
    """
    m = len(wanted)
    A, x, turns = np.empty((m, m)), np.empty(m), np.empty((SWEEPS, m, m, 2))
    for p in range(m):
        x[p] = wanted[p]
        for q in range(m):
            A[p, q] = mobility[p, q]
    sweeps = 0
    for sweep in range(SWEEPS):
        beside, size = 0.0, 0.0
        for p in range(m):
            size += A[p, p] ** 2
            for q in range(p):
                beside += A[p, q] ** 2
        if not beside > ROUNDING * size:
            break
        sweeps += 1
        for p in range(m):
            for q in range(p + 1, m):
                a = A[p, q]
                t = 0.0
                if a != 0.0:
                    t = 0.5 * (A[q, q] - A[p, p]) / a
                    t = math.copysign(1.0, t) / (abs(t) + math.sqrt(t * t + 1.0))
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                A[p, p] -= t * a
                A[q, q] += t * a
                A[p, q], A[q, p] = 0.0, 0.0
                for k in range(m):
                    if k != p and k != q:
                        u, v = A[k, p], A[k, q]
                        A[k, p], A[k, q] = c * u - s * v, s * u + c * v
                        A[p, k], A[q, k] = A[k, p], A[k, q]
                x[p], x[q] = c * x[p] - s * x[q], s * x[p] + c * x[q]
                turns[sweep, p, q, 0], turns[sweep, p, q, 1] = c, s
    for p in range(m):
        short = max(0.0, 1.0 - max(A[p, p], 0.0) / region)
        x[p] *= A[p, p] / (A[p, p] ** 2 + (damping * short) ** 2)
    for sweep in range(sweeps - 1, -1, -1):
        for p in range(m - 1, -1, -1):
            for q in range(m - 1, p, -1):
                c, s = turns[sweep, p, q, 0], turns[sweep, p, q, 1]
                x[p], x[q] = c * x[p] + s * x[q], c * x[q] - s * x[p]
    return x


@inner_kernel
def acceleration(
    inverse: Array, J_c: Array, J: Array, error: Array,
    q_c: Array, dq_c: Array, dq_ahead: Array, q: Array, dq: Array, weight: Array,
    period_s: float, damping: float, stiffness: float, null_damping: float, null_stiffness: float,
    region: float, singular_damping: float,
) -> Array:  # fmt: skip
    """Return the joint accelerations (n,) [rad/s²] that bring tool and joints to the command.

    The joints are at q, dq (n,), the command (`_c`) is at q_c, dq_c and has rates `dq_ahead` one
    period on. J_c and J (6, n) are the tool's Jacobians there and here, `error` (6,) leads from
    here to there. `inverse` (n, n) is M⁻¹. `weight` (6,) says what a radian counts where the
    tool's mobility is judged against the `region` [1/kg].
    """
    n = len(q)
    ahead, own = np.empty(n), np.empty(n)
    for j in range(n):
        ahead[j] = (dq_ahead[j] - dq_c[j]) / period_s
        own[j] = ahead[j] + null_damping * (dq_c[j] - dq[j]) + null_stiffness * (q_c[j] - q[j])
    drift_c, tool = drift(J_c, dq_c), drift(J, dq)
    moved, mobility, wanted = np.zeros((6, n)), np.zeros((6, 6)), np.empty(6)
    for i in range(6):
        tool[i] = drift_c[i] - tool[i] + stiffness * error[i]
        for j in range(n):
            tool[i] += J_c[i, j] * (ahead[j] + damping * dq_c[j])
            tool[i] -= J[i, j] * (own[j] + damping * dq[j])
            for k in range(n):
                moved[i, j] += weight[i] * J[i, k] * inverse[k, j]
        for k in range(i + 1):
            for j in range(n):
                mobility[i, k] += moved[i, j] * J[k, j] * weight[k]
            mobility[k, i] = mobility[i, k]
        wanted[i] = weight[i] * tool[i]
    push = damped(mobility, wanted, region, singular_damping)
    for i in range(6):
        for j in range(n):
            own[j] += moved[i, j] * push[i]
    return own


@compiled(
    MATRIX, VECTOR, VECTOR,
    MATRIX, MATRIX, MATRIX, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR,
    NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER,
)  # fmt: skip
def computed_torque(
    M: Array, h: Array, beside: Array,
    inverse: Array, J_c: Array, J: Array, error: Array,
    q_c: Array, dq_c: Array, dq_ahead: Array, q: Array, dq: Array, weight: Array,
    period_s: float, damping: float, stiffness: float, null_damping: float, null_stiffness: float,
    region: float, singular_damping: float,
) -> Array:  # fmt: skip
    """Return the torques (n,) [N·m] of that `acceleration`: M (n, n) of it, h, and what is beside.

    h (n,) is what keeps the joints from accelerating, `beside` (n,) what is given on top.
    """
    ddq = acceleration(
        inverse, J_c, J, error, q_c, dq_c, dq_ahead, q, dq, weight,
        period_s, damping, stiffness, null_damping, null_stiffness, region, singular_damping,
    )  # fmt: skip
    tau = np.empty(len(h))
    for i in range(len(tau)):
        tau[i] = h[i] + beside[i]
        for j in range(len(tau)):
            tau[i] += M[i, j] * ddq[j]
    return tau


# --- How much of a measured wrench is answered at once, when the load may not be as declared ------
#
# A load of mass m that is declared and is not there reads like a force −m a, with a how the
# tool accelerates: to answer it feeds a back, with m times the mobility that the tool has
# without it, and with the delay of bus and drives. From about 1 on the arm swings by itself. So
# what lasts is answered in full, and of what changes as large a share as keeps that product at
# `GAIN`. It stays above `LEAST`: the same load makes the law's own loop too stiff, which the
# answer makes up for.

GAIN = 1.0
"""The feedback of an acceleration by a load that is not there, at most [1]."""
LEAST = 0.2
"""The share of a change that is always answered at once [1]."""
LASTS_HZ = 2.0
"""Corner of the low-pass that tells what lasts [Hz]."""


@compiled(MATRIX, MATRIX, VECTOR, NUMBER)
def share_at_once(inverse: Array, J: Array, at: Array, mass: float) -> float:
    """Return the share (0 to 1) of a wrench's change that is answered at once.

    `inverse` (n, n) is M⁻¹ with the load of `mass` [kg], which is at `at` (3,) [m] in the frame of
    J (6, n). The mobility is judged by its Frobenius norm, 1 to √3 times that of the freest way.
    """
    n = J.shape[1]
    of_load = np.empty((3, n))
    for j in range(n):
        of_load[0, j] = J[0, j] + J[4, j] * at[2] - J[5, j] * at[1]
        of_load[1, j] = J[1, j] + J[5, j] * at[0] - J[3, j] * at[2]
        of_load[2, j] = J[2, j] + J[3, j] * at[1] - J[4, j] * at[0]
    squares = 0.0
    for a in range(3):
        for b in range(3):
            mobility = 0.0
            for i in range(n):
                for j in range(n):
                    mobility += of_load[a, i] * inverse[i, j] * of_load[b, j]
            squares += mobility * mobility
    part = mass * math.sqrt(squares)  # of the inertia that moves with it; without it, 1 − part
    if part <= GAIN * (1.0 - part):
        return 1.0
    return max(LEAST, GAIN * (1.0 - part) / part)


@compiled(MATRIX, VECTOR, VECTOR, NUMBER)
def held_back(J: Array, wrench: Array, lasting: Array, share: float) -> Array:
    """Return the joint torques (n,) of a wrench (6,) that are not answered at once [N·m]."""
    out = np.zeros(J.shape[1])
    for j in range(len(out)):
        for i in range(6):
            out[j] += (1.0 - share) * J[i, j] * (wrench[i] - lasting[i])
    return out


# --- Torque setpoints of drives in CST: the computed torque, with measured and observed forces ----
#
# τ = M q̈* + h − Jᵀ F − r
#
# with M q̈* + h of `torque.py`, F the *measured* force on the arm, as far as it is
# believed (`believed.py`), and r what the momentum observer (`momentum.py`) found beside it.
#
# A torque that is computed from what SYNC k sampled acts from SYNC k + 1 to k + 2: the state is
# predicted to k + 1 with the torque that acts until then. M and h are those of the declared
# payload.
#
# The law asks for no more than the motors may give and change by in a period: each joint goes
# as far towards its torque as its bounds let it. The prediction and the observer know what was
# sent, so that what was held back is no disturbance, and nothing winds up. A force that changes
# is answered as far as a declared load that is not there leaves the arm at rest
# (`torque.py`).

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
        then = predict(
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
        return T, jacobian_at(k.J, lever) if nonzero(lever) else k.J

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
