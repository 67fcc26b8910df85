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

from ...config.schema.mechanism import Drive
from ...protocols.canopen.can301 import EmcyCode
from ...protocols.messages.rig import RigFault
from .fault_values import value_of, vector_of
from .nodes.force_torque_node import SimulatedForceTorque
from .nodes.link import NodeLink
from .nodes.servo_node import SimulatedDrive
from .physics.world import World

SENSOR = "force_torque"
"""The target that names the sensor, and the tool."""

MOST_FORCE = 5000.0
"""The physics is not pushed harder along an axis: it would break before the arm does [N]."""
MOST_FRICTION = 1e4
"""Nor is a joint braked harder [N·m]."""
LONGEST_DELAY_S = 10.0
"""A frame that is later than this might as well be lost [s]."""


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
            if fault.on and fault.value is None:
                raise ValueError("fault delay: give its value in seconds")
            link.delay_s = value_of(fault, 0.0, LONGEST_DELAY_S, "s") if fault.on else 0.0
        else:
            share = value_of(fault, 0.0, 1.0, "of all frames", default=1.0)
            setattr(link, fault.kind, share if fault.on else 0.0)

    def _freeze(self, fault: RigFault) -> None:
        if fault.target != SENSOR:
            raise ValueError(f"fault freeze: its target is {SENSOR}, not a joint")
        self._force_torque(fault).freeze(fault.on, mute=bool(fault.value))

    def _stick(self, fault: RigFault, joint: int, drive: SimulatedDrive) -> None:
        torque = value_of(fault, 0.0, MOST_FRICTION, "N·m", default=_half_torque(drive.drive))
        self._world.set_extra_friction(joint, torque if fault.on else 0.0)

    def _push(self, fault: RigFault) -> None:
        force = vector_of(fault, MOST_FORCE, "N") if fault.on else None
        if fault.target == SENSOR:
            self._world.push_tool(force)
        else:
            self._world.push_joint(self._joints[fault.target], force)

    def _guide(self, fault: RigFault) -> None:
        if fault.target != SENSOR:
            raise ValueError(f"fault hand: its target is {SENSOR}, not a joint")
        force = vector_of(fault, MOST_FORCE, "N") if fault.on else None
        duration_s = None if fault.value is None else value_of(fault, 0.01, 3600.0, "s")
        self._world.push_tool(force, duration_s)


def _emcy(fault: RigFault, _joint: int, drive: SimulatedDrive) -> None:
    if fault.on:
        drive.emergency(round(value_of(fault, 0, 0xFFFF, "", default=EmcyCode.OVERTEMPERATURE)))


def _half_torque(drive: Drive) -> float:
    return drive.max_torque / 2
