"""A force-reflecting handle at the operator's side: its loop, its device, and what bounds it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from ...config.schema.network import HandleSection, HandSection, ReflectionSection
from ...protocols.messages import messages as m
from ...protocols.messages.messages import Reflection
from ...protocols.messages.telemetry import State
from ...server.reflection import Port, damping
from .protocol_client import RoundTrip

# --- Kinematics of a desktop device: three motors at its base, and a passive gimbal at its end ----
Array = NDArray[np.float64]

UPPER = 0.14  # from the shoulder to the elbow [m]
FORE = 0.14  # from the elbow to the gimbal [m]


def place(q: Array) -> Array:
    """Return the gimbal's centre (3,) [m] from where it is at q = 0; base axes, z up.

    q (3,) [rad]: the base's turn about z, the upper link's pitch over the horizontal, and the fore
    link's over the vertical, both from the base by a parallel linkage.
    """
    turn, upper, fore = q.tolist()
    reach = UPPER * math.cos(upper) + FORE * math.sin(fore)
    height = UPPER * math.sin(upper) - FORE * math.cos(fore)
    return np.array([reach * math.cos(turn) - UPPER, reach * math.sin(turn), height + FORE])


def jacobian(q: Array) -> Array:
    """Return J_HC (6, 3): the handle's twist is J_HC dq, and joint torques are J_HCᵀ wrench.

    The gimbal is free, so the motors neither turn the handle nor exert a moment on it.
    """
    turn, upper, fore = q.tolist()
    c, s = math.cos(turn), math.sin(turn)
    reach = UPPER * math.cos(upper) + FORE * math.sin(fore)
    out, fore_out = -UPPER * math.sin(upper), FORE * math.cos(fore)
    J = np.zeros((6, 3))
    J[:3] = [
        [-reach * s, out * c, fore_out * c],
        [reach * c, out * s, fore_out * s],
        [0.0, UPPER * math.cos(upper), FORE * math.sin(fore)],
    ]
    return J


# --- Simulated handle in a simulated hand: mass, damper and spring behind three motors ------------
#
# Virtual time, a millisecond a step. What the motors do and what the hand feels is its own
# truth: energies here are works of forces along ways, whoever commanded them.
STEP_S = 0.001  # step of the device and of its own control [s]

ROTOR = 4e-4  # inertia of each motor at its joint [kg·m²]


class HandPath:
    """Intended path of the hand: from place to place, at rest in each (minimum jerk)."""

    def __init__(self) -> None:
        self._start, self._end = np.zeros(3), np.zeros(3)
        self._start_s, self._seconds = 0.0, 0.0

    def move(self, place_m: Array, seconds: float, now_s: float) -> None:
        """Go to a place (3,) [m] within some time, from where it is meant to be now."""
        self._start, self._end = self.at(now_s)[0], place_m
        self._start_s, self._seconds = now_s, seconds

    def at(self, now_s: float) -> tuple[Array, Array]:
        """Return place (3,) [m] and velocity (3,) [m/s]."""
        if now_s >= self._start_s + self._seconds:
            return self._end, np.zeros(3)
        s = max(0.0, (now_s - self._start_s) / self._seconds)
        way = self._end - self._start
        part = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        rate = 30.0 * s**2 * (1.0 - s) ** 2 / self._seconds
        return self._start + part * way, rate * way


class SimulatedHandle:
    """One handle, held or let go; `spring`: whether it is drawn to its centre, as a stick is."""

    def __init__(self, handle: HandleSection, hand: HandSection) -> None:
        self._handle, self._hand = handle, hand
        self.q, self.dq = np.zeros(3), np.zeros(3)
        self.path = HandPath()
        self.held = True
        self.spring = True
        self.p, self.v = np.zeros(3), np.zeros(3)
        """The handle's place [m] and velocity [m/s] in the axes of its base."""
        self.force = np.zeros(3)
        """Reflected force of the motors on the hand in the last step (3,) [N]."""
        self.work = 0.0
        """Work of the hand against reflection so far: negative where it was given some [J]."""

    def step(self, wrench: Array, now_s: float) -> float:
        """Move on by a step under a wrench to reflect (6,) [N, N·m]; return the hand's work [J]."""
        wrench = self._bounded(wrench)
        J = jacobian(self.q)
        linear = J[:3]
        tau = J.T @ wrench + linear.T @ self._other_forces(now_s)
        M = self._handle.mass * (linear.T @ linear) + ROTOR * np.eye(3)
        # The Jacobian's own change, along the motion, gives the mass' centripetal torque.
        turned = jacobian(self.q + STEP_S * self.dq)[:3]
        tau -= self._handle.mass * (linear.T @ ((turned - linear) @ self.dq)) / STEP_S
        self.dq = self.dq + STEP_S * np.linalg.solve(M, tau)
        self.q = self.q + STEP_S * self.dq
        before, self.p = self.p, place(self.q)
        self.v = (self.p - before) / STEP_S
        self.force = wrench[:3]
        work = -float(self.force @ (self.p - before))
        self.work += work
        return work

    def _other_forces(self, now_s: float) -> Array:
        """Return the force (3,) [N] of the hand, and of the mechanism's spring and dampers."""
        force = -self._handle.damping * self.v
        if self.spring:
            force = force - self._handle.spring * self.p - self._handle.spring_damping * self.v
        if self.held:
            p, v = self.path.at(now_s)
            force = force + self._hand.stiffness * (p - self.p) + self._hand.damping * (v - self.v)
        return np.asarray(force)

    def _bounded(self, wrench: Array) -> Array:
        """Return the wrench as strong as the motors can make it; they exert no moment."""
        size = math.sqrt(float(wrench[:3] @ wrench[:3]))
        out = np.zeros(6)
        out[:3] = wrench[:3] * min(1.0, self._handle.max_force / max(size, 1e-12))
        return out


# --- Loop of rate mode through the operator: gain, bound, and low-pass above the bound ------------
#
# A stick makes the arm push with F = K_HC u / K_F whatever the network does (Williams 1997,
# 2.6): the arm's own loop sees to that. Reflected, the force moves the stick: a loop of gain `g
# = K_FR c K_HC / K_F` at rest, c being the stick's rate for each newton on it. Below one, a
# loop of gain g without resonance is stable at any delay (small gain); above, a low-pass that
# is slow against all delays takes the gain away where the phase is lost.
WELL_DAMPED = 0.7  # damping ratio from which a held stick counts as without resonance [1]
BOUND_DAMPED, BOUND = 0.6, 0.4  # greatest loop gain that needs no filter, well damped and not [1]
GREATEST = 4.0  # above this loop gain, the filtered loop does not settle either [1]
FILTER_PER_GAIN = 1.5  # filter time for each unit of gain, as a part of all delays [1]
ARM_S = 0.08  # lag of the arm's side: its force loop, drives and filter [s]


@dataclass(frozen=True)
class HeldStick:
    """Dynamics of a stick with a hand on it, as the loop sees it."""

    rate_per_force: float  # c: the rate that it asks for, for each newton on it [m/s/N]
    damping_ratio: float  # ζ [1]
    lag_s: float  # delay of its response to a force [s]

    @classmethod
    def of(cls, handle: HandleSection, hand: HandSection) -> Self:
        """Take it from the springs and dampers of handle and hand."""
        stiffness = handle.spring + hand.stiffness
        damping = handle.damping + handle.spring_damping + hand.damping
        return cls(
            handle.speed / handle.travel / stiffness,
            damping / (2.0 * math.sqrt(stiffness * handle.mass)),
            damping / stiffness,
        )

    @property
    def bound(self) -> float:
        """Greatest loop gain that needs no filter [1]."""
        return BOUND_DAMPED if self.damping_ratio >= WELL_DAMPED else BOUND

    def filter_s(self, gain: float, round_trip_s: float) -> float:
        """Return the low-pass time that a loop gain needs at a round trip, 0 for none [s]."""
        if gain <= self.bound:
            return 0.0
        return FILTER_PER_GAIN * gain * (round_trip_s + ARM_S + self.lag_s)


# --- Client of a reflecting handle: the force it feels, the commands it sends, its protection -----
#
# Given what comes in and the time, as a `ProtocolClient`; the same in virtual and in real time.
Mode = Literal["rate", "pose"]

HANDLE_RESERVE = 0.1
"""Part of the energy bound that may leave the handle's port before anything has entered [1]."""

MOST_DAMPING = 0.1
"""Damping that the port injects, at most, as a part of mass / step: more of it would ring [1]."""

SILENCE_S = 0.3  # without news for this long, the force fades [s]
FADE_S = 0.3  # it has faded within this; then nothing is sent any more [s]

CALM_S = 2.0  # a longest round trip is forgotten with this time constant [s]

LONGEST_LAPSE_S = 0.25  # after a longer lapse the device's time goes on without making it up [s]


class ReflectingClient:
    """One handle, and the protection of its loop."""

    def __init__(self, config: ReflectionSection, now_s: float) -> None:
        self._config = config
        self.device = SimulatedHandle(config.handle, config.hand)
        self.trip = RoundTrip()
        self.mode: Mode = "rate"
        self.axes = m.Frame.CRF
        self.port = Port()
        """The handle's port: what the hand put into the network, and got out of it."""
        self._now_s = now_s
        self._news: Reflection | None = None
        self._news_s = now_s
        self._far = 0.0
        self._slowest_s: float | None = None
        self._filtered = np.zeros(6)
        self._share = 0.0
        self._stick = HeldStick.of(config.handle, config.hand)

    def set_mode(self, mode: Mode, axes: m.Frame) -> None:
        """Be a stick on a spring, or a free handle whose pose leads; `axes` are what it lies in."""
        self.mode, self.axes = mode, axes
        self.device.spring = mode == "rate"

    # --- what comes in ------------------------------------------------------------------------

    def on_state(self, state: State, now_s: float) -> None:
        before = self.trip.heard_s
        self.trip.echoed(state.last_seq, now_s)
        newest = self.trip.seconds
        if newest is None or self.trip.heard_s == before:
            return
        kept = 0.0 if self._slowest_s is None or before is None else self._slowest_s
        if before is not None:
            kept = newest + (kept - newest) * math.exp((before - now_s) / CALM_S)
        self._slowest_s = max(newest, kept)

    def on_reflection(self, news: Reflection, now_s: float) -> None:
        """Take in what the arm feels; what was overtaken is old."""
        if self._news is None or news.tick > self._news.tick:
            if self._news is None or news.entered < self._news.entered:
                self._far -= news.entered  # a daemon that counts anew: from here
            else:
                self._far += news.entered - self._news.entered
            self._far = max(0.0, self._far)
            self._news, self._news_s = news, now_s

    @property
    def round_trip_s(self) -> float:
        """The longest round trip of late; the longest expected before one was seen [s]."""
        return self._config.largest_round_trip_s if self._slowest_s is None else self._slowest_s

    @property
    def silent(self) -> bool:
        """True when there was no news for so long that the force has faded."""
        return self._now_s - self._news_s > SILENCE_S and self._share <= 0.0

    @property
    def filter_s(self) -> float:
        """Time constant of the low-pass on what is reflected now [s]."""
        if self._news is None or not self._news.protected or self.mode == "pose":
            return 0.0
        gain = self._news.slope * self._stick.rate_per_force
        return self._stick.filter_s(gain, self.round_trip_s)

    # --- what goes on -------------------------------------------------------------------------

    def run(self, now_s: float) -> None:
        """Let handle and hand move on to now."""
        if now_s - self._now_s > LONGEST_LAPSE_S:
            self._now_s = now_s - STEP_S
        filter_s = self.filter_s
        part = 1.0 if filter_s <= 0.0 else 1.0 - math.exp(-STEP_S / filter_s)
        while self._now_s + STEP_S <= now_s + 1e-9:
            self._now_s += STEP_S
            self._step(part)

    def _step(self, part: float) -> None:
        fading = self._news is None or self._now_s - self._news_s > SILENCE_S
        way = (0.0 if fading else 1.0) - self._share
        self._share += math.copysign(min(abs(way), STEP_S / FADE_S), way)
        device, news = self.device, self._news
        wrench = np.zeros(6) if news is None else np.array(news.wrench)
        self._filtered = self._filtered + part * (wrench - self._filtered)
        injected = np.zeros(3)
        if self.mode == "pose" and news is not None and news.protected:
            injected = -self._damping() * device.v
        felt = self._share * self._filtered
        felt[:3] += injected
        before = device.p
        work = device.step(felt, self._now_s)
        kept = -float(injected @ (device.p - before))
        port = self.port.passed(work - kept)
        self.port = port._replace(damped=port.damped + max(0.0, kept))

    def _damping(self) -> float:
        """Return the damping that the passivity of the handle's port needs now [N·s/m]."""
        speed2 = float(self.device.v @ self.device.v)
        reserve = HANDLE_RESERVE * self._config.energy_bound
        most = MOST_DAMPING * self._config.handle.mass / STEP_S
        return min(most, damping(self.port, self._far, reserve, speed2, STEP_S))

    # --- what goes out ------------------------------------------------------------------------

    def stick(self, _now_s: float) -> Mapping[str, Any] | None:
        """Return what a `JoystickTwist` says now, None in silence."""
        if self.silent:
            return None
        handle = self._config.handle
        u = np.clip(self.device.p / handle.travel, -1.0, 1.0) * handle.speed
        return {"twist": (*u.tolist(), 0.0, 0.0, 0.0), "expressed_in": self.axes} | self._energy()

    def pose(self, _now_s: float) -> Mapping[str, Any] | None:
        """Return what a `MasterPose` says now, None in silence."""
        if self.silent:
            return None
        xyz = tuple(self.device.p.tolist())
        return {"xyz": xyz, "rpy": (0.0,) * 3, "expressed_in": self.axes} | self._energy()

    def _energy(self) -> dict[str, Any]:
        return {"handle": (self.port.entered, self.port.left, self.port.damped)}
