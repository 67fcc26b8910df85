"""Contact that no sensor sees, from the drives' torques.

A joint moves by what its drive gives and by what pushes the arm: with w the whole load that the
force/torque sensor reads, J its Jacobian, and M, C, g those of the arm without what hangs on it,

    τ_ext = M q̈ + C q̇ + g + Jᵀ w + τ_f − τ

is what pushes the arm inboard of the sensor; low-passed, it is unseen contact. Weight, inertial
forces and contact of the tool are all in w: what hangs there need not be known. It is the momentum
observer (De Luca & Mattone 2003) with the momentum's rate written out as a second difference over
the instants of the samples, which is one period late. Everything else is brought to that instant:
torques, which drives report of the period before, as the mean of two; the load by its own stamps. A
contact that grows by 1 N a millisecond is otherwise a push of 10 N.
The law of drives in CST has another (`momentum.py`): of what it sent and predicted, slower, and
without what friction may hold, because it acts on what it finds; this one judges what drives
report, and in every operation mode.

What is not known counts as nobody's push: Coulomb friction near standstill, whose sign may be
either, a part of the accelerating torque, and the change of a load within a period, which drives
and sensor see through filters of their own. It passes the same low-pass as the estimate, so that it
outweighs what it excuses at every instant.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...control.evolve import evolve
from ...control.hold.pushed import Pushed
from ...control.mechanism.dynamics import Dynamics
from ...control.spatial import Array, sizes

SLOW = 0.02
"""Joint speed above which the sign of friction is certain [rad/s]."""

CHATTER = 0.5
"""Contact that opens and closes between two samples is known to this part of what they jump [1]."""

CHATTER_S = 0.2
"""And goes on for about that long where samples happen to show nothing of it [s]."""

NOISE = 1.0
"""Jumps of less are the sensor's noise [N]."""


class SensorLoad(NamedTuple):
    """Reading of the force/torque sensor, and its age."""

    wrench: Array
    """All that the arm exerts on what is outboard (6,), at and in the Sensor frame [N, N·m]."""
    jump: Array
    """By how much one sample is off its neighbours' mean (6,) [N, N·m]."""
    lag_s: float
    """How much older the reading is than the joints [s]."""


class LoadUncertainty(NamedTuple):
    """Bounds of the error of the sensor's load."""

    force: float
    """[N]"""
    moment: float
    """[N·m]"""
    angle: float
    """By how much its axes may be turned [rad]."""


UNKNOWN_LOAD = LoadUncertainty(5.0, 0.5, math.radians(6.0))
"""A sensor of which nothing is known: its bias and its mounting."""


@dataclass(frozen=True)
class DetectorState:
    """Memory of the detector from tick to tick; empty at first."""

    q: tuple[Array, ...] = ()
    """Measured joints (n,) of the last two ticks, newest first [rad]."""
    tau: Array | None = None
    """The drives' torques (n,) one tick ago [N·m]."""
    load: SensorLoad | None = None
    """The sensor's reading of one tick ago."""
    external: Array | None = None
    """Low-passed torques (n,) of unseen contact, one tick ago [N·m]; None before it is known."""
    excused: Array | None = None
    """The part of that which friction and inertia may explain (n,) [N·m]."""
    chatter: Array | None = None
    """The part beside which chattering contact may explain (n,), dying away [N·m]."""
    lasting_s: float = 0.0
    """How long some joint's has been beyond its bound [s]."""
    time_s: float = 0.0
    """When the newest joints were sampled [s]."""
    step_s: float = 0.0
    """How long after those before them [s]."""


@dataclass(frozen=True)
class JointContact:
    """A joint that something pushes."""

    joint: int
    torque: float
    """Estimated external torque [N·m]."""
    bound: float
    """Bound that means contact [N·m]."""


class CollisionDetector:
    """Judges the drives' torques. `bound` (n,) [N·m] means contact if it lasts `confirm_s`.

    `friction` (n,) [N·m] is each joint's Coulomb friction, `doubt` the part of the accelerating
    torque that may be wrong.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        friction: Array,
        bound: Array,
        doubt: float,
        filter_hz: float,
        confirm_s: float,
        period_s: float,
    ) -> None:
        self.dynamics = dynamics
        self._friction = friction
        self._bound = bound
        self._doubt = doubt
        self._smoothing = 1.0 - math.exp(-2.0 * math.pi * filter_hz * period_s)
        self._dying = math.exp(-period_s / CHATTER_S)
        self._confirm_s = confirm_s
        self._period_s = period_s

    def measure(
        self,
        state: DetectorState,
        q: Array,
        tau: Array,
        load: SensorLoad | None,
        time_s: float | None,
        doubt: LoadUncertainty | None = None,
    ) -> DetectorState:
        """Return the state after one reading: joints q (n,) [rad] and torques tau (n,) [N·m].

        Without a `load`, nothing but what `dynamics` is told to carry hangs on the arm, and nothing
        touches it; `time_s` is when the joints were sampled [s], None if that is not known: a SYNC
        that is late by a tenth of a period is 10 rad/s² at 1 rad/s to who takes it to be in time.
        A load that is in `doubt` is worth as much less, wherever it points.
        """
        if time_s is None:
            return evolve(state, q=())
        T, step_s = self._period_s, time_s - state.time_s
        if abs(step_s - T) > 0.5 * T or (load is None) is not (state.load is None):
            # Ticks were missed, or a late one is followed by one in time: torques are the means of
            # other periods. What was felt until then is kept.
            state = evolve(state, q=())
        if len(state.q) < 2 or state.tau is None:
            return evolve(
                state, q=(q, *state.q[:1]), tau=tau, load=load, time_s=time_s, step_s=step_s
            )
        (q1, q2), before_s = state.q, state.step_s
        rate, rate_before = (q - q1) / step_s, (q1 - q2) / before_s
        dq = (before_s * rate + step_s * rate_before) / (step_s + before_s)
        ddq = 2.0 * (rate - rate_before) / (step_s + before_s)
        needed = self.dynamics.torque(q1, dq, ddq)
        accelerating = needed - self.dynamics.torque(q1, dq, np.zeros(len(q)))
        chatter = np.zeros(len(q))
        certain = np.minimum(np.maximum(dq / SLOW, -1.0), 1.0)
        # A drive reports the mean of the period before: two of them lie about the instant of q̈.
        external = needed + self._friction * certain - 0.5 * (tau + state.tau)
        excused = self._doubt * np.abs(accelerating) + self._friction * (1.0 - np.abs(certain))
        if load is not None and state.load is not None:
            J, change = self.dynamics.sensor_jacobian(q1), load.wrench - state.load.wrench
            external += (
                state.load.wrench + _part_until_then(state.load, load, step_s) * change
            ) @ J
            excused += np.abs(change @ J)
            if doubt is not None:
                excused += _doubted(doubt, load.wrench, J)
            if sizes(load.jump)[0] > NOISE:
                chatter = CHATTER * np.abs(load.jump @ J)
            if state.chatter is not None:
                chatter = np.maximum(chatter, self._dying * state.chatter)
        external = self._smoothed(state.external, external)
        excused = self._smoothed(state.excused, excused)
        beyond = bool((np.abs(external) > self._bound + excused + chatter).any())
        lasting_s = state.lasting_s + T if beyond else 0.0
        return DetectorState(
            (q, q1), tau, load, external, excused, chatter, lasting_s, time_s, step_s
        )

    def _smoothed(self, before: Array | None, now: Array) -> Array:
        """Low-pass, from nothing at first: brakes that open leave the drives' torques upset."""
        return self._smoothing * now + (0.0 if before is None else (1.0 - self._smoothing) * before)

    def touched(self, state: DetectorState) -> JointContact | None:
        """Return which joint is pushed most, against its bound, if one is for long enough."""
        if state.external is None or state.excused is None or state.chatter is None:
            return None
        if state.lasting_s <= self._confirm_s:
            return None
        bound = self._bound + state.excused + state.chatter
        j = int(np.argmax(np.abs(state.external) / bound))
        return JointContact(j, float(state.external[j]), float(bound[j]))

    def pushed(self, state: DetectorState) -> Pushed | None:
        """Return the estimate that a state holds, None before there is one."""
        if state.external is None or state.excused is None:
            return None
        excused = state.excused if state.chatter is None else state.excused + state.chatter
        return Pushed(state.external, excused, self._bound)


def _part_until_then(before: SensorLoad, now: SensorLoad, step_s: float) -> float:
    """Return which part of a load's change was over when the joints were sampled one step ago."""
    between_s = step_s - now.lag_s + before.lag_s
    return min(1.0, max(0.0, before.lag_s / between_s)) if between_s > 0.0 else 0.0


def _doubted(doubt: LoadUncertainty, wrench: Array, J: Array) -> Array:
    """Return the joint torques (n,) [N·m] that a doubtful wrench (6,) may be off by."""
    force, moment = sizes(wrench)
    arms = np.sqrt((J.reshape(2, 3, -1) ** 2).sum(axis=1))
    turned = 2.0 * math.sin(0.5 * doubt.angle)
    return np.asarray(
        (doubt.force + turned * force) * arms[0] + (doubt.moment + turned * moment) * arms[1]
    )
