"""Contact that no sensor sees, from the drives' torques.

A joint moves by what its drive gives and by what pushes the arm: τ_ext = M q̈ + C q̇ + g + τ_f − τ.
Of that, what the force/torque sensor sees at the tool is known; the rest, low-passed, is unseen
contact. It is the momentum observer (De Luca & Mattone 2003) with the momentum's rate written out
as a second difference over the instants of the samples, which is one period late. The law of drives
in CST has another (`momentum.py`): of what it sent and predicted, slower, and without what friction
may hold, because it acts on what it finds; this one judges what drives report, and in every
operation mode.

What is not known counts as nobody's push: Coulomb friction near standstill, whose sign may be
either, a part of the accelerating torque, and contact that the sensor is about to see. It passes
the same low-pass as the estimate, so that it outweighs what it excuses at every instant.
"""

import math
from dataclasses import dataclass

import numpy as np

from .dynamics import Dynamics
from .evolve import evolve
from .frames import Array

SLOW = 0.02
"""Joint speed above which the sign of friction is certain [rad/s]."""


@dataclass(frozen=True)
class TouchState:
    """What is remembered from tick to tick; empty at first."""

    q: tuple[Array, ...] = ()
    """Measured joints (n,) of the last two ticks, newest first [rad]."""
    tau: Array | None = None
    """The drives' torques (n,) one tick ago [N·m]."""
    seen: Array | None = None
    """Joint torques (n,) of the contact that the sensor saw one tick ago [N·m]."""
    external: Array | None = None
    """Low-passed torques (n,) of unseen contact, one tick ago [N·m]; None before it is known."""
    excused: Array | None = None
    """What of that friction and inertia may explain (n,) [N·m]."""
    lasting_s: float = 0.0
    """How long some joint's has been beyond its bound [s]."""
    time_s: float = 0.0
    """When the newest joints were sampled [s]."""
    step_s: float = 0.0
    """How long after those before them [s]."""


@dataclass(frozen=True)
class Touched:
    """A joint that something pushes."""

    joint: int
    torque: float
    """Estimated external torque [N·m]."""
    bound: float
    """What means contact [N·m]."""


class Touch:
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
        self._confirm_s = confirm_s
        self._period_s = period_s

    def measure(
        self,
        state: TouchState,
        q: Array,
        tau: Array,
        seen: Array,
        load: Array,
        time_s: float | None,
    ) -> TouchState:
        """Return the state after one reading: joints q (n,) [rad] and torques tau (n,) [N·m].

        `seen` (n,) [N·m] are the joint torques of the contact that the sensor reports, as it acts
        on the arm; `load` (10,) what the sensor carries, see `sources.force.load_of`;
        `time_s` when the joints were sampled [s], None if that is not known: a SYNC that is late by
        a tenth of a period is 10 rad/s² at 1 rad/s to who takes it to be in time.
        """
        if time_s is None:
            return evolve(state, q=())
        T, step_s = self._period_s, time_s - state.time_s
        if abs(step_s - T) > 0.5 * T:
            # Ticks were missed, or a late one is followed by one in time: torques are the means of
            # other periods. What was felt until then is kept.
            state = evolve(state, q=())
        if len(state.q) < 2 or state.tau is None or state.seen is None:
            return evolve(
                state, q=(q, *state.q[:1]), tau=tau, seen=seen, time_s=time_s, step_s=step_s
            )
        (q1, q2), before_s = state.q, state.step_s
        rate, rate_before = (q - q1) / step_s, (q1 - q2) / before_s
        dq = (before_s * rate + step_s * rate_before) / (step_s + before_s)
        ddq = 2.0 * (rate - rate_before) / (step_s + before_s)
        mass = float(load[0])
        self.dynamics.carry(mass, load[1:4] / max(mass, 1e-9))
        needed = self.dynamics.torque(q1, dq, ddq)
        accelerating = needed - self.dynamics.torque(q1, dq, np.zeros(len(q)))
        certain = np.clip(dq / SLOW, -1.0, 1.0)
        # A drive reports the mean of the period before: two of them lie about the instant of q̈.
        given = 0.5 * (tau + state.tau)
        external = needed + self._friction * certain - given - state.seen
        # What the sensor sees comes filtered: a contact that grows is seen up to a period late.
        excused = self._doubt * np.abs(accelerating) + np.abs(seen - state.seen)
        excused += self._friction * (1.0 - np.abs(certain))
        external = self._smoothed(state.external, external)
        excused = self._smoothed(state.excused, excused)
        beyond = bool((np.abs(external) > self._bound + excused).any())
        lasting_s = state.lasting_s + T if beyond else 0.0
        return TouchState((q, q1), tau, seen, external, excused, lasting_s, time_s, step_s)

    def _smoothed(self, before: Array | None, now: Array) -> Array:
        """Low-pass, from nothing at first: brakes that open leave the drives' torques upset."""
        return self._smoothing * now + (0.0 if before is None else (1.0 - self._smoothing) * before)

    def touched(self, state: TouchState) -> Touched | None:
        """Return which joint is pushed most, against its bound, if one is for long enough."""
        if state.external is None or state.excused is None or state.lasting_s <= self._confirm_s:
            return None
        bound = self._bound + state.excused
        j = int(np.argmax(np.abs(state.external) / bound))
        return Touched(j, float(state.external[j]), float(bound[j]))
