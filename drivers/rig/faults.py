"""Effects of a `RigFault` message on the rig. Every fault is taken back with `on = false`.

| kind | target | value |
|---|---|---|
| unplug | bus | nothing passes between the bus and its nodes |
| silence | device | the node neither sends nor hears |
| silence | base, carrier | no sensor tells where the frame is (`rig.py`) |
| drop, corrupt | device | probability per frame, 1 by default |
| delay | device | seconds of physics time, required |
| fault | joint | the power stage fails: EMCY 2310h; a reset works once it is off |
| emcy | joint | one emergency message with this code, 4310h by default; nothing else |
| restart | device | it starts anew, as after its supply was gone for a moment |
| block | joint | stands still mechanically, whatever the motor does |
| stick | joint | extra Coulomb friction [N·m], half the drive's torque by default |
| slip | wheel | its friction on the floor, 0.05 by default |
| freeze | force_torque | 0: repeats its last sample (default); 1: sends none |
| freeze | imu | repeats its last sample |
| bias | imu | its gyroscope reads so much more about each axis [rad/s], 0.06 by default |
| push | joint, force_torque | `vector` [N] in World at the link's centre of mass, at the MRF |
| slip | force_torque | the payload that arms hold together slips out of this one's grasp |
| hand | force_torque | `vector` [N] in World at the MRF; comes and goes in `value` s, as sin² |
| silence, drop, corrupt, crop | scanner | `sensors.py` |
| cover | tag | nobody sees it (`sensors.py`) |
| move | tag | `vector` [m] in World is its new place, its attitude stays |

A device is a joint, whose drive is meant, `force_torque`, `gripper`, or another one's name; with
several mechanisms it is one mechanism's: `left.s1`, `left.force_torque`. Its own faults are its
node's (`nodes/`), those of the connection its link's.
"""

from collections.abc import Mapping, Sequence

from ...protocols.messages.rig import MOST_FORCE, RigFault, value_of, vector_of
from .nodes.node import Node
from .nodes.wire import Wire
from .physics.world import World

OF_LINK = ("silence", "drop", "delay", "corrupt")
"""Faults of a node's connection to its bus."""
TOOL = "force_torque"
"""Target that names a mechanism's tool, where it has no sensor, too."""


class Faults:
    """Hands faults to the nodes and buses of one rig."""

    def __init__(
        self,
        world: World,
        nodes: Mapping[str, Node],
        wires: Mapping[str, Wire],
        prefixes: Sequence[str],
    ) -> None:
        """Take the rig's parts; names of each arm's devices begin with one of `prefixes`."""
        self._world, self._nodes, self._wires = world, nodes, wires
        self._tools = {f"{prefix}{TOOL}": arm for arm, prefix in enumerate(prefixes)}

    def inject(self, fault: RigFault) -> None:
        """Apply one fault. Raises `ValueError`, in one line, for one that makes no sense."""
        if fault.kind == "unplug":
            if fault.target not in self._wires:
                raise _unknown(fault, self._wires)
            self._wires[fault.target].plugged = not fault.on
            return
        if fault.kind == "slip" and fault.target in self._tools:
            self._slip(fault, self._tools[fault.target])
            return
        if fault.target in self._tools and fault.kind in ("push", "hand"):
            self._push_tool(fault)
            return
        node = self._nodes.get(fault.target)
        if node is None:
            raise _unknown(fault, self._nodes)
        if fault.kind in OF_LINK:
            node.link.disturb(fault)
        elif fault.kind == "restart":
            if fault.on:
                node.boot()
        else:
            node.inject(fault)

    def _slip(self, fault: RigFault, arm: int) -> None:
        beam = self._world.beam
        if beam is None or arm not in beam.held_by:
            raise ValueError(f"fault slip: {fault.target} holds no payload with others")
        pad = beam.held_by.index(arm)
        if fault.on:
            beam.let_go(pad)
        else:
            beam.take(pad)

    def _push_tool(self, fault: RigFault) -> None:
        force = vector_of(fault, MOST_FORCE, "N") if fault.on else None
        swells = fault.kind == "hand" and fault.value is not None
        duration_s = value_of(fault, 0.01, 3600.0, "s") if swells else None
        self._world.push_tool(force, duration_s, self._tools[fault.target])


def _unknown(fault: RigFault, known: Mapping[str, object]) -> ValueError:
    names = ", ".join(known)
    return ValueError(f"fault {fault.kind}: no target {fault.target!r}; there are {names}")
