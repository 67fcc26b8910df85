"""Force reflection: the force for the handle, passive ports over a delay, a held stick's loop."""

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from ..config.schema.network import HandleSection, HandSection, ReflectionSection
from ..protocols.messages.messages import Reflection
from .control.spatial import Array, rotate_twist
from .control.task.task import GAIN_TIME_S

# --- Two ports of a network with delay, each kept from giving out energy that it never got --------
#
# Time-domain passivity with delayed energies (Ryu, Artigas, Preusche, Mechatronics 20, 2010;
# Artigas, Ryu, Preusche, Hirzinger, IROS 2011): energy is counted at either port in two sums
# that never fall, what has entered the network and what has left it. A port knows what had
# *entered* at the other one, as late as the network is; it lets no more *leave* than that, and
# a small reserve. Late, reordered or lost news can only make it let out less. At the arm's port
# the controller is an admittance: it takes from the motion; at the handle's an impedance: it
# adds damping.

PARTS = (slice(0, 3), slice(3, 6))


class Port(NamedTuple):
    """Energy that passed a port so far [J]; neither number ever falls."""

    entered: float = 0.0
    """Into the network."""
    left: float = 0.0
    """Out of the network."""
    damped: float = 0.0
    """Taken out of what left by the port's own controller."""

    def passed(self, energy: float) -> "Port":
        """Return the port after an energy [J] went in, or out where it is negative."""
        if energy >= 0.0:
            return self._replace(entered=self.entered + energy)
        return self._replace(left=self.left - energy)


def admit(port: Port, far: float, reserve: float, force: Array, moved: Array) -> tuple[Port, Array]:
    """Return the arm's port, and the motion (6,) that it lets through of `moved` (6,) [m, rad].

    `force` (6,) [N, N·m] is what that motion works against, in the same axes: what is reflected.
    `far` [J] is what has entered at the handle. Where more would leave, a part of the motion along
    the force is taken away, never more than all of it.
    """
    works = [float(force[part] @ moved[part]) for part in PARTS]
    leaving = sum(works)
    left = far + reserve - port.left
    if leaving <= max(0.0, left):
        return port.passed(-leaving), moved
    pushing = sum(max(0.0, work) for work in works)
    share = min(1.0, (leaving - max(0.0, left)) / pushing)
    moved = moved.copy()
    for part, work in zip(PARTS, works, strict=True):
        if work > 0.0:
            moved[part] -= (share * work / float(force[part] @ force[part])) * force[part]
    return port.passed(share * pushing - leaving), moved


def damping(port: Port, far: float, reserve: float, speed2: float, step_s: float) -> float:
    """Return the damping [N·s/m] that pays within a step for what left the handle's port too much.

    `far` [J] is what has entered at the arm, `speed2` [m²/s²] the handle's speed, squared. What the
    hand never put in does not leave either, whatever the arm says.
    """
    owed = port.left - port.damped - min(far, port.entered) - reserve
    if owed <= 0.0 or speed2 <= 0.0:
        return 0.0
    return owed / (speed2 * step_s)


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


# --- Force reflection, the daemon's side: the force for the handle, and the arm's passivity port
#
# Nothing here moves the arm: it can only take away from what a master's pose asks for. The
# force loop at the arm depends on nothing of this, and on no network.

HandleEnergies = tuple[float, float, float]
"""Energy that entered at the handle, left there, and was damped of that [J]; see the messages."""

ARM_RESERVE = 0.5
"""Part of the energy bound that the arm's port may take out before it is told what entered [1]."""

FORGET_S = 2.0
"""The ledger over the handle's energy forgets with this time constant [s]."""


def pose_stiffness(
    reflected: Array, scale: float, force_gain: Array, position_gain: Array, contact: float
) -> float:
    """Return the greatest stiffness [N/m] that a master's pose feels, over all translations.

    `reflected` (6,) is K_FR, `scale` the clutch's, `contact` the environment's stiffness [N/m]: the
    arm's own loop is as stiff as K_P / K_F (6,), in series with that. Zero without force control.
    """
    k_f = float(force_gain[:3].min())
    k_p = float(position_gain[:3].max())
    if k_f <= 0.0 or k_p <= 0.0:
        return 0.0
    return float(reflected[:3].max()) * scale / (k_f / k_p + 1.0 / contact)


class Reflector:
    """Scales the MRF's wrench for the handle; keeps the arm's port and the ledger of energy."""

    def __init__(self, config: ReflectionSection, contact: float, period_s: float) -> None:
        """Begin at rest; `contact` is the stiffness of the stiffest environment [N/m]."""
        self._config = config
        self._contact = contact
        self._K_FR = np.array(config.gain)
        self._period_s = period_s
        self._ramp = -math.expm1(-self._period_s / GAIN_TIME_S)
        self._gain = np.zeros(6)
        self._wrench_mrf = np.zeros(6)
        self._handle: HandleEnergies = (0.0, 0.0, 0.0)
        self._far_at_start = 0.0
        self._heard_s = 0.0
        self._R_world_axes = np.eye(3)
        self._trips = False
        self.protected = True
        self.port = Port()
        self.wrench = np.zeros(6)
        """Wrench that the arm exerts, scaled, at the MRF in World axes (6,) [N, N·m]."""
        self.slope = 0.0
        """Steady scaled force for each rate of the stick [N·s/m]."""
        self.ledger = 0.0
        """Energy that the hand gave to the handle lately, less what it got [J]."""
        self.tripped = False
        """True while the net holds the force back."""

    # --- what the operator's side says --------------------------------------------------------

    def engage(self, handle: HandleEnergies | None) -> None:
        """Begin at the arm's port anew: a master engages. What entered before does not count."""
        self._far_at_start = 0.0 if handle is None else handle[0]
        self.port = self.port._replace(left=0.0)

    def admit(self, moved: Array, handle: HandleEnergies | None) -> Array:
        """Return the part of a master's motion (6,), in its axes, that may reach the target."""
        far = 0.0 if handle is None else max(0.0, handle[0] - self._far_at_start)
        if not self.protected:
            far = math.inf
        reserve = ARM_RESERVE * self._config.energy_bound
        force = rotate_twist(self._R_world_axes.T, self.wrench)
        self.port, moved = admit(self.port, far, reserve, force, moved)
        return moved

    def hear(self, handle: HandleEnergies | None, now_s: float, R_world_axes: Array) -> None:
        """Note the axes of a handle's news in World (3, 3); enter its energy into the ledger.

        The ledger forgets: a rate's stick gives some energy to the hand at every contact. One that
        bounces gives more. Below the bound, a protected force is held back until half is made up.
        """
        self._R_world_axes = R_world_axes
        if handle is None:
            return
        (entered, left, damped), before = handle, self._handle
        self._handle = handle
        gained = (entered - before[0]) - (left - before[1]) + (damped - before[2])
        if entered < before[0] or left < before[1] or damped < before[2]:
            gained = 0.0  # another handle, which counts from its own beginning
        self.ledger = self.ledger * math.exp((self._heard_s - now_s) / FORGET_S) + gained
        self._heard_s = now_s
        bound = -self._config.energy_bound
        tripped = self.ledger < (0.5 * bound if self.tripped else bound)
        self._trips = self._trips or (tripped and not self.tripped)
        self.tripped = tripped

    def take_trip(self) -> bool:
        """Return whether the net has tripped since the last call."""
        trips, self._trips = self._trips, False
        return trips

    # --- every tick ---------------------------------------------------------------------------

    def reflect(
        self,
        wrench_mrf: Array | None,
        gains: dict[str, Array],
        R_world_mrf: Array,
        scale: float,
        leading: bool,
    ) -> None:
        """Take in a tick's wrench (6,) and gains; `leading`: a master's pose leads the MRF.

        Along an axis without force control nothing is reflected: no law binds the force there.
        """
        k_f = gains["force"]
        gain, part = np.where(k_f > 0.0, self._K_FR, 0.0), 1.0
        if leading:
            k_p = gains["position"]
            stiff = pose_stiffness(gain, scale, k_f, k_p, self._contact)
            gain = gain * min(1.0, self._config.stiffness / max(stiff, 1e-9))
            # The contact answers a motion that leads with K_P + s: this pole leaves a spring of it.
            part = -math.expm1(-self._period_s * max(float(k_p[:3].max()), 1.0))
        if wrench_mrf is None or (self.tripped and self.protected):
            gain = np.zeros(6)
        if wrench_mrf is not None:
            self._wrench_mrf = self._wrench_mrf + part * (wrench_mrf - self._wrench_mrf)
        self._gain = self._gain + self._ramp * (gain - self._gain)
        self.wrench = rotate_twist(R_world_mrf, self._gain * self._wrench_mrf)
        slopes = np.divide(self._gain[:3], k_f[:3], out=np.zeros(3), where=k_f[:3] > 0.0)
        self.slope = float(slopes.max()) * scale * float(gains["joystick"][:3].max())

    def message(self, tick: int) -> Reflection:
        """Return what the operator is told, in the axes of the handle's newest news."""
        return Reflection.of_valid(
            tick=tick,
            wrench=tuple((-rotate_twist(self._R_world_axes.T, self.wrench)).tolist()),
            slope=self.slope,
            entered=self.port.entered,
            protected=self.protected,
            task=None,
        )
