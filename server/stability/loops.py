"""Stability of the sampled loops of a cell, with their delay: force, following, payload, torque."""

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...config.consistency import REQUIRED_POSTURES
from ...config.load import Cell
from ...config.schema.mechanism import TorqueSection
from ..control.forest import at_mrf
from ..control.mechanism.model import Dynamics, Mechanism
from ..control.mechanism.wrench import INERTIA_PERIODS, MEAN_PERIODS
from ..control.spatial import Array, Pose
from ..control.task.following import smoothing_s

# --- Stability bounds of the sampled force and position loops with the delay of a cell ------------
#
# A sampled integrator with `d` periods of delay is stable iff K T < 2 sin(π / (2(2d + 1))),
# where K is K_F k_e for force control against a wall (Williams 1997, section 2.5, sampled) and
# K_P for the position source.
#
# A contact that is not at the MRF turns the tool as well. With r from the MRF to the contact, a
# force f there is the wrench [f; r × f] at the MRF, and the twist [v; ω] moves the contact by v
# + ω × r. So the tool gives way there by X G Xᵀ, with X = [I −r̂; 0 I] and G the gains K_F:
# across r, by K_F + K_R r². The loop gains are the eigenvalues of that times the stiffness of
# what is touched.

GainVector = Sequence[float] | Array
"""One gain for each axis (6,)."""

BUS_PERIODS = 2.0
"""From what a SYNC samples to what a later SYNC applies [periods]."""
DRIVE_PERIODS = 1.0
"""Interpolation (half a period) and servo lag: the upper end of what trials gave [periods]."""
CORRECTION = (5.0, 0.5)
"""Change of force [N] and of moment [N·m] whose correction must not come late."""
POSTURE = "ready"
"""The posture at which the jerk limiter's lag is judged."""
_HALVINGS = 10
"""Bisections of the greatest distance between MRF and tool [1]."""


@dataclass(frozen=True)
class ForceAxis:
    """The force loop along one axis of the MRF."""

    stiffness: float
    """Stiffest environment [N/m] or [N·m/rad]."""
    delays: dict[str, float]
    """Delay of each part of the loop [periods]."""

    @property
    def delay_periods(self) -> float:
        """Delay of the whole loop [periods]."""
        return sum(self.delays.values())

    @property
    def bound(self) -> float:
        """Greatest stable K_F k_e T [1]."""
        return bound(self.delay_periods)


def bound(delay_periods: float) -> float:
    """Return the greatest stable K T of a sampled integrator behind a delay [1]."""
    return 2.0 * math.sin(math.pi / (2.0 * (2.0 * delay_periods + 1.0)))


def filter_periods(cutoff_hz: float, period_s: float) -> float:
    """Return the delay of the tick's first-order low-pass for slow signals [periods]."""
    return 1.0 / math.expm1(2.0 * math.pi * cutoff_hz * period_s)


def jerk_lag_s(step: float, acceleration: float, jerk: float) -> float:
    """Return the mean lag of a rate step behind acceleration and jerk bounds, same units [s]."""
    if step * jerk <= acceleration**2:
        return math.sqrt(step / jerk)
    return 0.5 * (step / acceleration + acceleration / jerk)


@dataclass(frozen=True)
class ToolContact:
    """The force loop where a point of the tool touches: of its modes, the nearest to its bound."""

    lever: float
    """From the MRF to the point [m]."""
    loop_gain: float
    """K_F k_e T of the mode [1]."""
    bound: float
    """Greatest stable one with the mode's delay [1]."""

    @property
    def share(self) -> float:
        """Loop gain over its bound: unstable from 1 on [1]."""
        return self.loop_gain / self.bound


class ForceLoop:
    """The force loop of one arm with any MRF and gains."""

    def __init__(self, cell: Cell) -> None:
        """Build it; raises `ValueError` for a cell without a force/torque sensor."""
        mechanism, period = cell.config.mechanism, cell.config.timing.period_s
        sensor = mechanism.force_torque
        if sensor is None:
            raise ValueError(f"cell {cell.config.name}: no force/torque sensor, so no force loop")
        self.period_s = period
        self.tip = Pose.from_xyz_rpy(mechanism.T_wrist_mrf.xyz, mechanism.T_wrist_mrf.rpy)
        """The MRF of the cell: the point of the tool that touches."""
        place = sensor.T_wrist_sensor
        self.T_wrist_sensor = Pose.from_xyz_rpy(place.xyz, place.rpy)
        k, k_rotation = sensor.stiffest_environment, sensor.stiffest_environment_rotation
        self.stiffness = np.array([k] * 3 + [k_rotation] * 3)
        """Of the stiffest environment (6,) [N/m, N·m/rad]."""
        back = self.T_wrist_sensor.p - self.tip.p
        length = float(np.linalg.norm(back))
        touching = sensor.contact_length
        share = 1.0 if touching is None or length <= touching else touching / length
        # What touches the tool beside its tip is a point, about which it may turn.
        self._touching = (
            (self.tip.p, self.stiffness),
            (self.tip.p + share * back, np.array([k] * 3 + [0.0] * 3)),
        )
        """Ends of the part of the tool that may touch, in the Wrist, and the stiffness there."""
        self._parts = {
            "bus": BUS_PERIODS,
            "drive": DRIVE_PERIODS,
            "sensor": 0.5 / (sensor.rate_hz * period),
            "inertia": INERTIA_PERIODS if sensor.inertia else 0.0,
            "filter": filter_periods(sensor.filter_hz, period),
        }
        model = Mechanism.from_cell(cell)
        drives = {d.joint: d for d in mechanism.drives}
        ordered = [drives[j.name] for j in cell.robot.joints]
        self._accelerations = np.array([d.max_acceleration for d in ordered])
        self._jerks = np.array([d.max_jerk for d in ordered])
        self._wrist = model.wrist(np.array(mechanism.postures[POSTURE]))

    def axes(self, gains: GainVector, mrf: Pose | None = None) -> list[ForceAxis | None]:
        """Return the loop along each axis of an MRF at gains K_F (6,), by default the cell's MRF.

        None for an axis along which a short arm cannot move.
        """
        found: list[ForceAxis | None] = []
        for i, reach in enumerate(self._tool_bounds(self.tip if mrf is None else mrf)):
            if reach is None:
                found.append(None)
                continue
            step = abs(gains[i]) * CORRECTION[0 if i < 3 else 1]
            lag = jerk_lag_s(step, *reach) / self.period_s
            found.append(ForceAxis(float(self.stiffness[i]), {**self._parts, "jerk limit": lag}))
        return found

    def touching(self, gains: GainVector, mrf: Pose | None = None) -> ToolContact:
        """Return the loop at the point of the tool that is nearest to its bound, or beyond it.

        Loop gains are convex along a straight tool: one of the ends of what touches is the worst.
        """
        at = self.tip if mrf is None else mrf
        return self._worst(gains, at, self.axes(gains, at))

    def _worst(self, gains: GainVector, mrf: Pose, axes: list[ForceAxis | None]) -> ToolContact:
        return max((self._contact(*c, gains, mrf, axes) for c in self._touching), key=_share)

    def reach(self, gains: GainVector, mrf: Pose) -> float:
        """Return how far from the tool's tip the MRF may be, on the way to a pose [m].

        Judged by the delays there, which grow on the way; 0 where the gains are too high at the tip
        itself.
        """
        low, high, axes = 0.0, 1.0, self.axes(gains, mrf)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            there = Pose(mrf.R, self.tip.p + middle * (mrf.p - self.tip.p))
            stable = self._worst(gains, there, axes).share < 1.0
            low, high = (middle, high) if stable else (low, middle)
        return low * float(np.linalg.norm(mrf.p - self.tip.p))

    def gives(self, gains: GainVector, com: Array, mrf: Pose | None = None) -> float:
        """Return K_F where a payload's centre of mass com (3,) is, Sensor axes [m/s/N]."""
        at = self.tip if mrf is None else mrf
        point = self.T_wrist_sensor.R @ com + self.T_wrist_sensor.p
        X = _to_point(at.R.T @ (point - at.p))[:3]
        G = _able(self.axes(gains, at)) * np.array(gains)
        return float(np.linalg.eigvalsh(X @ (G[:, None] * X.T))[-1])

    def lever(self, mrf: Pose | None = None) -> float:
        """Return how far from an MRF, by default the cell's, the tool may be touched [m]."""
        at = self.tip.p if mrf is None else mrf.p
        return max(float(np.linalg.norm(point - at)) for point, _ in self._touching)

    def _contact(
        self,
        point: Array,
        stiffness: Array,
        gains: GainVector,
        mrf: Pose,
        axes: list[ForceAxis | None],
    ) -> ToolContact:
        """Return the loop of a contact at a point (3,) in the Wrist."""
        r = mrf.R.T @ (point - mrf.p)
        delays = np.array([0.0 if axis is None else axis.delay_periods for axis in axes])
        G, root = _able(axes) * np.array(gains), np.sqrt(stiffness)
        X = root[:, None] * _to_point(r)
        values, modes = np.linalg.eigh(X @ (G[:, None] * X.T))
        lever, found = float(np.linalg.norm(r)), []
        for value, mode in zip(values * self.period_s, modes.T, strict=True):
            # By how much each axis takes part in the mode.
            parts = np.abs(G) * (X.T @ mode) ** 2
            if parts.sum() > 0.0:
                late = float(parts @ delays / parts.sum())
                found.append(ToolContact(lever, float(value), bound(late)))
        return max(found, key=_share, default=ToolContact(lever, 0.0, 2.0))

    def _tool_bounds(self, mrf: Pose) -> list[tuple[float, float] | None]:
        """Return the tool's acceleration and jerk bounds along each axis that the arm can move.

        Six of ([m/s²], [m/s³]) or ([rad/s²], [rad/s³]), in MRF axes at the posture `ready`, as far
        as the joints' own bounds allow; None for an axis that a short arm lacks.
        """
        k = at_mrf(*self._wrist, mrf)
        J = np.kron(np.eye(2), k.T_world_mrf.R.T) @ k.J
        if np.linalg.matrix_rank(J, tol=1e-6) == len(J):
            inverse = np.linalg.pinv(J)
        else:  # a short arm turns where it will while it moves, and the other way round
            halves = np.linalg.pinv(J[:3], rcond=1e-6), np.linalg.pinv(J[3:], rcond=1e-6)
            inverse = np.hstack(halves)
        found: list[tuple[float, float] | None] = []
        for i in range(6):
            rates = np.abs(inverse[:, i])
            if J[i] @ inverse[:, i] < 0.5:
                found.append(None)
                continue
            rates = np.maximum(rates, 1e-12)
            a, j = self._accelerations / rates, self._jerks / rates
            found.append((float(a.min()), float(j.min())))
        return found


def _share(contact: ToolContact) -> float:
    return contact.share


def _able(axes: list[ForceAxis | None]) -> Array:
    """Return 1 for each axis (6,) that the arm can move along, 0 for the others."""
    return np.array([0.0 if axis is None else 1.0 for axis in axes])


def _to_point(r: Array) -> Array:
    """Return X (6, 6), which maps the twist of a frame to that of a point at r (3,) in it."""
    x, y, z = r
    X = np.eye(6)
    X[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return X


def vision_periods(cell: Cell) -> float:
    """Return the delay that the view's loop is judged with [periods].

    A picture's lateness is taken out by the pose that the arm had when it was exposed; what is
    left is the drives' delay, and an error of the stamp, of which a whole interval between two
    pictures of the slowest camera is allowed for.
    """
    slowest = min((c.rate_hz for c in cell.config.cameras), default=math.inf)
    stamp_s = 1.0 / slowest
    return BUS_PERIODS + DRIVE_PERIODS + stamp_s / cell.config.timing.period_s


# --- Stability of following a hand: delays of the loop, and the stiffest hand that it bears -------

AHEAD_PERIODS = 1.0
"""The reference is integrated to the end of the period, the others' rates act in it [periods]."""

HELD_PERIODS = 0.5
"""A speed or a torque is held for a period, a position is interpolated [periods]."""


def delays(cell: Cell, payload: float | None = None) -> dict[str, float]:
    """Return by how much each part makes the tool later than the hand's force asks [periods].

    Under a payload [kg], by default the cell's own. Raises `ValueError` for a cell without a
    force/torque sensor.
    """
    sensor, period = cell.config.mechanism.force_torque, cell.config.timing.period_s
    if sensor is None:
        raise ValueError(f"cell {cell.config.name}: no force/torque sensor, so no hand is felt")
    mode, following = cell.config.mechanism.operation_mode, cell.config.sources.following
    mass = sensor.payload.mass if payload is None else payload
    return {
        "sensor": MEAN_PERIODS,
        "inertia": INERTIA_PERIODS if sensor.inertia else 0.0,
        "filter": filter_periods(sensor.filter_hz, period),
        "payload": smoothing_s(following.payload_smoothing_s, mass, following.mass) / period,
        "bus": BUS_PERIODS - AHEAD_PERIODS,
        "drive": {
            "csp": 0.0,
            "csv": HELD_PERIODS,
            "cst": HELD_PERIODS + cell.config.torque.lag_s / period,
        }[mode],
    }


def stiffest_hand(
    cell: Cell, share: float = 1.0, payload: float | None = None, turning: float = 0.0
) -> float:
    """Return the stiffness of a hand at which following would begin to swing [N/m].

    With `G(s) = share / (M s² + B s) + turning / (I s² + B_a s)`, the loop is
    `1 + k G e^(−s d) / (1 + s τ)`, τ the low-pass under the payload [kg] and d the rest of the
    delay. It swings where its phase is −π. `turning` is the share of the moment that is followed,
    times the square of the lever from the MRF to the hand [m²].
    """
    f, T = cell.config.sources.following, cell.config.timing.period_s
    late = delays(cell, payload)
    tau = late.pop("payload") * T
    d = sum(late.values()) * T
    share = max(share, 1e-9)

    def gives(w: float) -> complex:
        s = 1j * w
        moves = share / (f.mass * s + f.damping) + turning / (f.inertia * s + f.angular_damping)
        return moves / s

    low, high = 0.0, 0.5 * math.pi / d
    for _ in range(100):
        w = 0.5 * (low + high)
        late_enough = w * d + math.atan(w * tau) - cmath.phase(gives(w)) >= math.pi
        low, high = (low, w) if late_enough else (w, high)
    w = 0.5 * (low + high)
    return math.hypot(1.0, w * tau) / abs(gives(w))


# --- Stability of the loop that a payload's own inertial force closes through the sensor, sampled
#
# What follows the measured force accelerates the tool, the sensor feels the payload's inertia,
# and that is taken off again as far as encoders and sensor agree:
#
#     source: M ẍ + B ẋ = F, or ẋ = K_F F ─► drives ─► payload m ─► sensor: −m ẍ ─┐
#        ▲                                      └──► encoders: + m Δ²x/T² ────────┤
#        └──────────────────────────────── low-pass ◄─────────────────────────────┘
#
# Drives in CSP and CSV run from setpoint to setpoint at steps of speed, so that their
# acceleration is great after a SYNC and small before the next. A sensor of few samples a period
# misses a part of it, encoders miss nothing: the difference is mass that the tool seems to have
# less of. Where that comes near to M, the tool runs away or swings.

STEPS = 10
"""Least number of steps into which a period is divided [1]. Their rule (speed first) has encoders
half a step off the sensor: no real pair agrees better."""

DRIVE_DAMPING = 0.7
"""Damping ratio of a drive's loop where the cell says only how fast it is [1]."""

HEAVIEST = 200.0
"""Payloads beyond this are not looked at [kg]."""

FASTEST = 0.8
"""Swinging faster than this part of half the tick's rate is not counted: what a drive would have to
turn round in every tick, the joints' friction holds [1]."""

LIGHTEST = 0.1
"""Payloads below this are not looked at [kg]."""

GROWTH = 1.3
"""Payloads are tried in steps of this factor [1]."""

_STANDS = 1e-5
"""A pole this near to 1 is where the arm stands, not how it moves [1]."""


class SourceModel(NamedTuple):
    """Discrete model of a source, from a tick's force F to speed and path: v' = keep·v + push·F."""

    keep: float
    push: float
    drift: float
    """Path of the period per speed [s]."""
    shift: float
    """Path of the period per force [m/N]."""
    stiffness: float = 0.0
    """Of the reference [1/s]."""
    calm: float = 1.0
    """Share of a new force that is taken over, per tick [1]."""


def following_source(cell: Cell, payload: float, share: float = 1.0) -> SourceModel:
    """Return the damped mass that follows a share of the hand's force under a payload [kg]."""
    f, T = cell.config.sources.following, cell.config.timing.period_s
    tau, time_s = f.mass / f.damping, smoothing_s(f.payload_smoothing_s, payload, f.mass)
    keep = math.exp(-T / tau)
    through = tau * (1.0 - keep)
    calm = 1.0 if time_s <= 0.0 else -math.expm1(-T / time_s)
    push, shift = share * (1.0 - keep) / f.damping, share * (T - through) / f.damping
    return SourceModel(keep, push, through, shift, f.stiffness, calm)


def force_source(cell: Cell, gain: float) -> SourceModel:
    """Return accommodation with the gain K_F [m/s/N]."""
    return SourceModel(0.0, gain, 0.0, gain * cell.config.timing.period_s)


class PayloadLoop:
    """The sampled loop of a cell's arm at a posture under a payload's inertial force."""

    def __init__(self, cell: Cell, posture: str = "ready", averaged: bool = True) -> None:
        """Build; raises `ValueError` for a cell without a force/torque sensor.

        `averaged` is the loop of who follows the mean readings, else that of the newest ones.
        """
        c = cell.config
        sensor, T = c.mechanism.force_torque, c.timing.period_s
        if sensor is None:
            raise ValueError(f"cell {c.name}: no force/torque sensor, so no payload is felt")
        self._cell, self._T = cell, T
        self._samples = max(1, round(sensor.rate_hz * T))
        self._averaged = averaged
        self._new_share = -math.expm1(-2.0 * math.pi * sensor.filter_hz * T)
        self._inertia = sensor.inertia
        self._torque = c.mechanism.operation_mode == "cst"
        mechanism = Mechanism.from_cell(cell)
        by_joint = {d.joint: d for d in c.mechanism.drives}
        drives = [by_joint[j] for j in mechanism.joints]
        place, mrf = sensor.T_wrist_sensor, c.mechanism.T_wrist_mrf
        T_wrist_sensor = Pose.from_xyz_rpy(place.xyz, place.rpy)
        self._q = np.array(c.mechanism.postures[posture])
        self._com = np.array(sensor.payload.com)
        # A cell with a [rig] says there what its drives are like.
        rig, n = c.rig, mechanism.n
        rotors = np.array([d.rotor_inertia for d in drives])
        if rig is not None:
            rotors = np.broadcast_to(np.array(rig.drive.armature), (n,)).copy()
        self._dynamics = Dynamics(mechanism, rotors, T_wrist_sensor)
        tool = mechanism.kinematics(self._q, Pose.from_xyz_rpy(mrf.xyz, mrf.rpy)).J
        at_com = T_wrist_sensor @ Pose(np.eye(3), self._com)
        self._J_com = mechanism.kinematics(self._q, at_com).J[:3]
        self._J = tool[:3]
        self._rates_of = np.linalg.pinv(tool, rcond=1e-3)[:, :3]

    def radius(self, source: SourceModel, payload: float) -> float:
        """Return the greatest magnitude of the loop's poles with a payload [kg]; stable below 1."""
        poles = np.linalg.eigvals(self._period(source, payload))
        moves = np.abs(poles - 1.0) > _STANDS
        slow = np.abs(np.angle(poles)) < math.pi * FASTEST
        return float(np.abs(poles[moves & slow]).max(initial=0.0))

    def _drives(self, M: Array) -> Array:
        """Return stiffness, damping and integral gain of the drives' loops (3, n, 1)."""
        rig, own = self._cell.config.rig, np.diag(M)
        w = 2.0 * math.pi * self._cell.config.mechanism.drive_hz
        gains = np.array([w**2 * own, 2.0 * DRIVE_DAMPING * w * own, 0.0 * own])
        if rig is not None:
            told = (rig.drive.stiffness, rig.drive.damping, rig.drive.integral)
            gains = np.array([np.broadcast_to(np.array(gain), own.shape) for gain in told])
        return gains[:, :, None]

    def _period(self, source: SourceModel, m: float) -> Array:
        """Return what one period makes of the state, from a SYNC on: a square matrix."""
        T, n = self._T, len(self._q)
        J, J_com, rates_of = self._J, self._J_com, self._rates_of
        self._dynamics.carry(m, self._com)
        M = self._dynamics.terms(self._q, np.zeros(n)).M
        K, D, integral = self._drives(M)
        steps = self._samples * math.ceil(STEPS / self._samples)
        dt = T / steps
        # Every quantity is a block of rows: what it is made of, of the state before.
        sizes = (n,) * 7 + (3,) * 9
        state = np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1])
        q, v, summed, target, aimed, told, a = state[:7]
        before, older, oldest, seen, last, filtered, calm, speed, ref = state[7:]
        contact, place = 0.5 * (seen + last), J_com @ q
        if self._inertia:
            newer, trend = place - 2.0 * before + older, before - 2.0 * older + oldest
            ahead = 0.0 if self._averaged else 1.0 - INERTIA_PERIODS
            contact = contact + (m / T**2) * (newer + ahead * (newer - trend))
        filtered = filtered + self._new_share * (contact - filtered)
        calm = calm + source.calm * (filtered - calm)
        path = source.drift * speed + source.shift * calm
        speed = source.keep * speed + source.push * calm
        asked = rates_of @ (speed + source.stiffness * (ref - J @ target))
        ref = ref + path
        acting = rate = reference = np.zeros_like(q)
        if self._torque:
            # The torque of this tick acts in the next period: the state is carried on to there.
            ahead_q, ahead_v, acting = q + T * v + 0.5 * T**2 * a, v + T * a, a
            law = self._cell.config.torque
            errors = law.damping * (told - ahead_v) + law.stiffness * (target - ahead_q)
            a = (asked - told) / T + errors
        else:
            reference, rate = aimed, (target - aimed) / T
        aimed, target = target, target + T * asked
        sampled, push = np.zeros_like(seen), np.linalg.inv(M)
        for i in range(steps):
            now = acting
            if not self._torque:
                now = push @ (D * (rate - v) + K * (reference - q) + integral * summed)
                summed = summed + dt * (reference - q)
                reference = reference + dt * rate
            v = v + dt * now
            q = q + dt * v
            if (i + 1) % (steps // self._samples) == 0:
                share = 1.0 / self._samples if self._averaged else float(i + 1 == steps)
                sampled = sampled - share * m * (J_com @ now)
        joints = (q, v, summed, target, aimed, asked, a)
        return np.concatenate(
            [*joints, place, before, older, sampled, seen, filtered, calm, speed, ref]
        )


def heaviest(
    cell: Cell,
    source: Callable[[float], SourceModel],
    averaged: bool = True,
    postures: tuple[str, ...] = REQUIRED_POSTURES,
) -> float:
    """Return the payload [kg] from which on a source would swing the tool; inf for none.

    `source` gives it under a payload [kg]. Looked for at the named postures, up to `HEAVIEST`.
    """
    different = {cell.config.mechanism.postures[name]: name for name in postures}
    loops = [PayloadLoop(cell, name, averaged) for name in different.values()]

    def stands(mass: float) -> bool:
        return all(loop.radius(source(mass), mass) < 1.0 + _STANDS for loop in loops)

    low, high = 0.0, LIGHTEST
    while stands(high):
        if high >= HEAVIEST:
            return math.inf
        low, high = high, high * GROWTH
    for _ in range(5):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stands(middle) else (low, middle)
    return low


# --- Stability of the torque law with its delay, and with an inertia that differs from the model's
#
# One axis of the law in its own terms: a unit inertia as the law believes, `ratio` times that
# in truth, a torque that acts one period late and is held for a period, the prediction over
# that delay, and the momentum observer.

RATIOS = (0.5, 1.0, 2.0)
"""True inertia over the modelled one, for which the loop has to be stable [1]."""


_TORQUE_HALVINGS = 12
"""Bisections of the stable range [1]."""


def spectral_radius(gains: TorqueSection, period_s: float, ratio: float) -> float:
    """Return the greatest magnitude of the sampled loop's poles: stable below 1.

    The pole at 1 that an observer of bandwidth 0 leaves is not counted.
    """
    A = np.array([_step(column, gains, period_s, ratio) for column in np.eye(5)]).T
    if gains.observer == 0.0:
        A = A[:4, :4]
    return float(np.abs(np.linalg.eigvals(A)).max())


def lightest_ratio(gains: TorqueSection, period_s: float) -> float:
    """Return the least true inertia over the modelled one with which the loop is stable [1]."""
    low, high = 0.0, 1.0
    for _ in range(_TORQUE_HALVINGS):
        ratio = 0.5 * (low + high)
        stable = spectral_radius(gains, period_s, ratio) < 1.0
        low, high = (low, ratio) if stable else (ratio, high)
    return high


def _step(s: Array, gains: TorqueSection, T: float, ratio: float) -> Array:
    """Return error, rate, torque that acts, torque that acted, momentum: one period later."""
    x, v, sent, acted, expected = s
    expected = expected + T * acted
    r = gains.observer * (v - expected) / (1.0 + gains.observer * T)
    a = sent + r
    torque = -gains.stiffness * (x + T * (v + 0.5 * T * a)) - gains.damping * (v + T * a) - r
    true = sent / ratio
    return np.array([x + T * (v + 0.5 * T * true), v + T * true, torque, sent, expected + T * r])
