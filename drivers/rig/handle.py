"""A force-reflecting handle in an operator's hand: three motors at its base, a passive gimbal."""

import math

import numpy as np
from numpy.typing import NDArray

from ...config.schema.network import HandleSection, HandSection

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
