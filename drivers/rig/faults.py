"""What a `RigFault` message does to the rig. Every fault is taken back with `on = false`.

| kind | target | value |
|---|---|---|
| silence | joint, force_torque | the node neither sends nor hears |
| silence | base, carrier | no sensor tells where the frame is (`rig.py`) |
| drop, corrupt | joint, force_torque | probability per frame, 1 by default |
| delay | joint, force_torque | seconds of physics time, required |
| fault | joint | the power stage fails: EMCY 2310h; a reset works once it is off |
| emcy | joint | one emergency message with this code, 4310h by default; nothing else |
| block | joint | stands still mechanically, whatever the motor does |
| stick | joint | extra Coulomb friction [N·m], half the drive's torque by default |
| freeze | force_torque | 0: repeats its last sample (default); 1: sends none |
| push | joint, force_torque | `vector` [N] in World at the link's centre of mass, at the MRF |
| hand | force_torque | `vector` [N] in World at the MRF; comes and goes in `value` s, as sin² |
| cover | tag | nobody sees it (`tags.py`) |
| move | tag | `vector` [m] in World is its new place, its attitude stays |
"""

from collections.abc import Callable, Mapping

import numpy as np

from ...config.mechanism import Drive
from ...protocols.can301 import EmcyCode
from ...protocols.rig import RigFault
from .force_torque_node import SimulatedForceTorque
from .link import NodeLink
from .servo_node import SimulatedDrive
from .world import World

SENSOR = "force_torque"
"""The target that names the sensor, and the tool."""


class Faults:
    """Applies faults to the nodes and the physics of one rig."""

    def __init__(
        self,
        world: World,
        drives: Mapping[str, SimulatedDrive],
        sensor: SimulatedForceTorque | None,
    ) -> None:
        self._world = world
        self._drives = drives
        self._joints = {name: i for i, name in enumerate(drives)}
        self._sensor = sensor
        self._on_joint: dict[str, Callable[[RigFault, int, SimulatedDrive], None]] = {
            "fault": lambda fault, _, drive: drive.break_down(fault.on),
            "emcy": _emcy,
            "block": lambda fault, joint, _: world.set_jam(joint, jammed=fault.on),
            "stick": self._stick,
        }

    def inject(self, fault: RigFault) -> None:
        """Apply one fault. Raises `ValueError`, in one line, for one that makes no sense."""
        if fault.target not in self._joints and fault.target != SENSOR:
            known = ", ".join((*self._joints, SENSOR))
            raise ValueError(f"fault {fault.kind}: no target {fault.target!r}; there are {known}")
        if fault.kind == "push":
            self._push(fault)
        elif fault.kind == "hand":
            self._guide(fault)
        elif fault.kind == "freeze":
            self._freeze(fault)
        elif fault.kind in ("silence", "drop", "delay", "corrupt"):
            self._disturb(fault, self._link(fault))
        elif fault.target == SENSOR:
            raise ValueError(f"fault {fault.kind}: its target is a joint, not {SENSOR}")
        else:
            joint = self._joints[fault.target]
            self._on_joint[fault.kind](fault, joint, self._drives[fault.target])

    def _link(self, fault: RigFault) -> NodeLink:
        if fault.target in self._drives:
            return self._drives[fault.target].link
        return self._force_torque(fault).link

    def _force_torque(self, fault: RigFault) -> SimulatedForceTorque:
        if self._sensor is None:
            raise ValueError(f"fault {fault.kind}: the cell has no force/torque sensor")
        return self._sensor

    def _disturb(self, fault: RigFault, link: NodeLink) -> None:
        if fault.kind == "silence":
            link.silent = fault.on
        elif fault.kind == "delay":
            if fault.on and (fault.value is None or fault.value < 0):
                raise ValueError("fault delay: give its value in seconds, 0 or more")
            link.delay_s = (fault.value or 0.0) if fault.on else 0.0
        else:
            share = 1.0 if fault.value is None else fault.value
            if not 0 <= share <= 1:
                raise ValueError(f"fault {fault.kind}: value {share} is no probability")
            setattr(link, fault.kind, share if fault.on else 0.0)

    def _freeze(self, fault: RigFault) -> None:
        if fault.target != SENSOR:
            raise ValueError(f"fault freeze: its target is {SENSOR}, not a joint")
        self._force_torque(fault).freeze(fault.on, mute=bool(fault.value))

    def _stick(self, fault: RigFault, joint: int, drive: SimulatedDrive) -> None:
        torque = _half_torque(drive.drive) if fault.value is None else fault.value
        if torque < 0:
            raise ValueError(f"fault stick: value {torque} N·m is below 0")
        self._world.set_extra_friction(joint, torque if fault.on else 0.0)

    def _push(self, fault: RigFault) -> None:
        if fault.on and fault.vector is None:
            raise ValueError("fault push: give its vector [N], in World")
        force = np.array(fault.vector) if fault.on and fault.vector is not None else None
        if fault.target == SENSOR:
            self._world.push_tool(force)
        else:
            self._world.push_joint(self._joints[fault.target], force)

    def _guide(self, fault: RigFault) -> None:
        if fault.target != SENSOR:
            raise ValueError(f"fault hand: its target is {SENSOR}, not a joint")
        if fault.on and fault.vector is None:
            raise ValueError("fault hand: give its vector [N], in World")
        if fault.value is not None and fault.value <= 0:
            raise ValueError(f"fault hand: value {fault.value} s is not above 0")
        force = np.array(fault.vector) if fault.on and fault.vector is not None else None
        self._world.push_tool(force, fault.value)


def _emcy(fault: RigFault, _joint: int, drive: SimulatedDrive) -> None:
    if fault.on:
        code = EmcyCode.OVERTEMPERATURE if fault.value is None else round(fault.value)
        if not 0 <= code <= 0xFFFF:
            raise ValueError(f"fault emcy: value {code} is no error code of 16 bits")
        drive.emergency(code)


def _half_torque(drive: Drive) -> float:
    return drive.max_torque / 2
