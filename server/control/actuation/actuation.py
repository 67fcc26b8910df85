"""Setpoints of the drives for a commanded motion: positions, speeds or torques."""

from typing import Protocol

import numpy as np

from ..bodies.rates import ArmTick
from ..compiled import VECTOR, compiled
from ..inputs import Intent, Payload
from ..joints import Joints
from ..mechanism.model import Dynamics
from ..spatial import GRAVITY, Array
from ..stop.limiter import TOLERANCE
from .torque import TorqueLaw, Torques, TorqueState

# --- Setpoints of the drives for a commanded motion: positions, speeds or torques -----------------
#
# The last stage before the bus. It changes no motion: it says the same motion in the unit of
# the drives' operation mode, and refuses a torque or a speed that is not to be sent, as the
# gate refuses a posture.


class Actuation(Protocol):
    """One operation mode."""

    def __call__(self, tick: ArmTick, state: TorqueState | None, /) -> TorqueState | None:
        """Write to the tick what to send for its motion, what limits that, and what refuses it.

        `state` is the memory of a torque law; returns the next one.
        """
        ...


def by_position(tick: ArmTick, _state: TorqueState | None) -> None:
    """CSP: the commanded posture."""
    tick.command = tick.q


class BySpeed:
    """CSV: the commanded rates, and what brings the joints to the command."""

    def __init__(self, joints: Joints, gain: float) -> None:
        """Build it; `gain` [1/s] leads joints to the command."""
        self._joints, self._gain = joints.names, gain
        self._most = (1.0 + TOLERANCE) * joints.velocity + gain * joints.following_window

    def __call__(self, tick: ArmTick, _state: TorqueState | None) -> None:
        """Send the speeds (n,) [rad/s]."""
        tick.command = tick.dq + self._gain * tick.error
        tick.refusal = _beyond(self._joints, tick.command, self._most, "speed", "rad/s")


class OnWheels:
    """CSV for the two wheels of a base, CSP for its arm."""

    def __init__(self, by_speed: BySpeed) -> None:
        self._by_speed = by_speed

    def __call__(self, tick: ArmTick, state: TorqueState | None) -> None:
        """Send the wheels' speeds [rad/s], and the arm's posture [rad] (n,)."""
        self._by_speed(tick, state)
        tick.command = np.concatenate((tick.command[:2], tick.q[2:]))


class ByTorque:
    """CST: the torques of the law, inside the bounds of torque and of its rate."""

    def __init__(
        self,
        joints: tuple[str, ...],
        law: TorqueLaw,
        *,
        wrench_of_bias: Array | None,
        most: Array,
        most_step: Array,
    ) -> None:
        """Build it: torques are within `most` (n,) [N·m], and change by `most_step` (n,) a period.

        `wrench_of_bias` (6, 6) makes the wrench at and in the Wrist of a sensor's bias; None
        without a sensor, which carries the payload that the law's dynamics have.
        """
        self._law, self._wrench_of_bias = law, wrench_of_bias
        # Scratch: what the law's dynamics carry.
        self._carried: bytes | None = None
        self._joints, self._most = joints, most
        self._step = (1.0 + TOLERANCE) * most_step

    def __call__(self, tick: ArmTick, state: TorqueState | None) -> TorqueState | None:
        """Send the torques (n,) [N·m]."""
        offset, inputs, load = np.zeros(6), tick.inputs, tick.wrist.load
        if self._wrench_of_bias is not None and load is not None:
            self._carry(load[:4])
            offset = self._wrench_of_bias @ load[4:]
        kept, torques = self._law.step(
            state,
            inputs.q_measured,
            tick.commanded.motion,
            tick.motion,
            tick.kinematics,
            None if tick.hand is None else -tick.hand,
            inputs.settings.T_wrist_mrf,
            inputs.time_s,
            inputs.intent is Intent.SEED,
            offset,
        )
        tick.command = tau = torques.tau
        tick.limits += self._told(torques)
        tick.refusal = _beyond(self._joints, tau, self._most, "torque", "N·m")
        if tick.refusal is None and state is not None:
            step = tau - state.tau
            tick.refusal = _beyond(self._joints, step, self._step, "torque step", "N·m")
        return kept

    def _carry(self, load: Array) -> None:
        """Let the law's dynamics have a payload (4,): mass [kg], and it times the centre [kg·m]."""
        key = load.tobytes()
        if key != self._carried:
            mass = float(load[0])
            self._law.carry(mass, load[1:] / max(mass, 1e-9))
            self._carried = key

    def _told(self, torques: Torques) -> tuple[str, ...]:
        """Return the names of what limits the joints."""
        if not (torques.beyond.any() or torques.held_back.any()):
            return ()
        return tuple(
            f"{what}:{joint}"
            for what, which in (("disturbance", torques.beyond), ("torque", torques.held_back))
            for joint, so in zip(self._joints, which.tolist(), strict=True)
            if so
        )


def _beyond(joints: tuple[str, ...], value: Array, most: Array, what: str, unit: str) -> str | None:
    """Return why values (n,) may not be sent, or None. What is not finite is beyond, too."""
    j = _first_beyond(value, most)
    if j < 0:
        return None
    return f"{joints[j]}: {what} {value[j]:.4g} beyond {most[j]:.4g} {unit}"


@compiled(VECTOR, VECTOR)
def _first_beyond(value: Array, most: Array) -> int:
    """Return the first of values (n,) that is not within `most` (n,), or −1."""
    for j in range(len(value)):
        if not abs(value[j]) <= most[j]:
            return j
    return -1


# --- Torques that hold an arm where it stands: the drives' preload before their brakes open -------


class HoldingTorque:
    """Gravity torques of one arm with its payload."""

    def __init__(self, dynamics: Dynamics, own: Payload | None) -> None:
        """Build it; `own` is the cell's payload, None without a force/torque sensor."""
        self._dynamics, self._own = dynamics, own

    def __call__(self, q: Array, payload: Payload | None, R_world_base: Array) -> Array:
        """Return the torques (n,) [N·m] at q (n,) [rad] with a `payload`, or else the cell's own.

        R_world_base (3, 3) tells how Base is tilted. Without a force/torque sensor the arm carries
        the URDF's tool.
        """
        payload = payload or self._own
        if self._own is not None and payload is not None:
            self._dynamics.carry(payload.mass, payload.com)
        self._dynamics.fall(R_world_base.T @ GRAVITY)
        still = np.zeros(len(q))
        return self._dynamics.torque(q, still, still)
