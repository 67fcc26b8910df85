"""Stability of the loop that a payload's own inertial force closes through the sensor, sampled.

What follows the measured force accelerates the tool, the sensor feels the payload's inertia, and
that is taken off again as far as encoders and sensor agree:

    source: M ẍ + B ẋ = F, or ẋ = K_F F ─► drives ─► payload m ─► sensor: −m ẍ ─┐
       ▲                                      └──► encoders: + m Δ²x/T² ────────┤
       └──────────────────────────────── low-pass ◄─────────────────────────────┘

Drives in CSP and CSV run from setpoint to setpoint at steps of speed, so that their acceleration is
great after a SYNC and small before the next. A sensor of few samples a period misses a part of it,
encoders miss nothing: the difference is mass that the tool seems to have less of. Where that comes
near to M, the tool runs away or swings.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...config.agree.agree import REQUIRED_POSTURES
from ...config.load import Cell
from ..control.mechanism.contact_wrench import INERTIA_PERIODS
from ..control.mechanism.dynamics import Dynamics
from ..control.mechanism.kinematics import Mechanism
from ..control.spatial import Array, Pose
from ..control.task.sources.following import smoothing_s

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
