"""Holding brakes of the joints, jams, and friction: whatever keeps a joint from moving."""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....config.schema.rig import RigDriveSection

Vector = NDArray[np.float64]

STANDS = 1e-3
"""A brake holds a joint that is slower than this [rad/s]."""


class Brakes:
    """Brakes of the joints of one world; `first` is the first joint's freedom in the model."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        joints: Sequence[str],
        first: int,
        q: Vector,
        drives: Sequence[tuple[int, RigDriveSection]],
    ) -> None:
        """Find the locks in the model; `drives` are, for each arm, how many, and what they are."""
        self._model, self._data, self._first = model, data, first
        n = len(joints)
        self._q, self._dq = q, data.qvel[first : first + n]
        self._ids = [int(model.equality(f"{name}_lock").id) for name in joints]
        self._locks = np.zeros((n, 2), dtype=bool)  # brake, jam
        self._delay_s = np.concatenate([np.full(k, drive.brake_closes_s) for k, drive in drives])
        self._torque = np.concatenate([_torques(k, drive) for k, drive in drives])
        self._friction: Vector = model.dof_frictionloss[first : first + n].copy()
        self._sticks = np.zeros(n)
        self._closing: dict[int, float] = {}
        """When brakes will have closed [s], by joint."""
        self._slipping: dict[int, float] = {}
        """Speed of joints whose brakes slip, a step ago [rad/s]."""

    def delay_s(self, joint: int) -> float:
        """Return how long the brake of a joint takes to close [s]."""
        return float(self._delay_s[joint])

    def set(self, joint: int, *, closed: bool) -> None:
        """Switch a brake's coil off, so that it closes, or on."""
        if not closed:
            self._closing.pop(joint, None)
            if self._slipping.pop(joint, None) is not None:
                self._rub(joint)
            self._lock(joint, 0, False)
        elif not self._locks[joint, 0] and joint not in self._slipping:
            self._closing.setdefault(joint, float(self._data.time) + self._delay_s[joint])
            self.step()

    def lock(self) -> None:
        """Close all brakes where the joints are: they have been closed for long."""
        for joint in range(len(self._ids)):
            self._lock(joint, 0, True)

    def jam(self, joint: int, *, jammed: bool) -> None:
        """Block a joint mechanically where it is, or free it."""
        self._lock(joint, 1, jammed)

    def stick(self, joint: int, torque: float) -> None:
        """Add Coulomb friction [N·m] to a joint's own; 0 takes it back."""
        self._sticks[joint] = torque
        self._rub(joint)

    def step(self) -> None:
        """Close the brakes that are due, and let those hold that slipped until now."""
        if not self._closing and not self._slipping:
            return
        now = float(self._data.time) + 1e-9
        for joint in [j for j, at_s in self._closing.items() if at_s <= now]:
            del self._closing[joint]
            if np.isfinite(self._torque[joint]):
                self._slipping[joint] = float(self._dq[joint])
                self._rub(joint)
            else:
                self._lock(joint, 0, True)
        for joint, before in list(self._slipping.items()):
            speed = float(self._dq[joint])
            self._slipping[joint] = speed
            if abs(speed) < STANDS or speed * before < 0.0:
                del self._slipping[joint]
                self._rub(joint)
                self._lock(joint, 0, True)

    def _rub(self, joint: int) -> None:
        brake = self._torque[joint] if joint in self._slipping else 0.0
        own = self._friction[joint] + self._sticks[joint]
        self._model.dof_frictionloss[self._first + joint] = own + brake

    def _lock(self, joint: int, which: int, on: bool) -> None:
        was = bool(self._locks[joint].any())
        self._locks[joint, which] = on
        now = bool(self._locks[joint].any())
        if now and not was:
            self._model.eq_data[self._ids[joint], 0] = self._q[joint]
        self._data.eq_active[self._ids[joint]] = now


def _torques(count: int, drive: RigDriveSection) -> Vector:
    """Return the torques of an arm's brakes [N·m]: infinite where the cell tells none."""
    torques = drive.brake_torque
    if len(torques) not in (0, 1, count):
        raise ValueError(
            f"[rig.drive] brake_torque: {len(torques)} values for {count} joints; give 1 or {count}"
        )
    return (
        np.full(count, torques[0] if torques else np.inf) if len(torques) < 2 else np.array(torques)
    )
