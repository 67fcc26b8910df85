"""Mechanical faults of a joint: blocked, braked, pushed."""

from .....config.schema.mechanism.mechanism import DriveSection
from .....protocols.messages.rig import RigFault
from ...fault_values import MOST_FORCE, MOST_FRICTION, value_of, vector_of
from ...physics.robot.chassis import GRIP
from ...physics.world import World


def inject_at_joint(fault: RigFault, world: World, joint: int, drive: DriveSection) -> None:
    """Apply a fault to a joint of the physics. Raises `ValueError` for one that it has not."""
    if fault.kind == "block":
        world.set_jam(joint, jammed=fault.on)
    elif fault.kind == "stick":
        half = drive.max_torque / 2
        torque = value_of(fault, 0.0, MOST_FRICTION, "N·m", default=half)
        world.set_extra_friction(joint, torque if fault.on else 0.0)
    elif fault.kind == "slip":
        friction = value_of(fault, 0.0, GRIP, "", default=0.05)
        world.set_grip(joint, friction if fault.on else GRIP)
    elif fault.kind == "push":
        world.push_joint(joint, vector_of(fault, MOST_FORCE, "N") if fault.on else None)
    else:
        raise ValueError(f"fault {fault.kind}: its target is force_torque, not a joint")
