"""Agreement between a cell's sections, and between the cell and its robot."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from ..drives.joint_bounds import joint_bounds
from ..errors import ConfigError, nearest
from ..schema.cell import CellConfig
from ..schema.mechanism.mechanism import DriveSection, MechanismSection
from ..urdf.robot import Robot, UrdfJoint
from .cameras import camera_disagreements
from .modes import mode_disagreements
from .obstacles import obstacle_disagreements
from .priority import priority_disagreements
from .rover import rover_disagreements
from .sources import source_disagreements

REQUIRED_POSTURES: Final = ("start", "ready")
INT32_MAX: Final = 2**31 - 1


def check_agreement(
    path: Path, config: CellConfig, robot: Robot, words: Callable[[str], str]
) -> None:
    """Raise `ConfigError`, of all disagreements found, each naming the file and the key.

    `words` turns a complaint about a mechanism's cell into one that begins with the file's key.
    """
    found = list(_pairing(config.mechanism.drives, robot)) or list(_disagreements(config, robot))
    if found:
        raise ConfigError(*(f"{path}: {words(text)}" for text in found))


def _disagreements(config: CellConfig, robot: Robot) -> Iterator[str]:
    joints = {joint.name: joint for joint in robot.joints}
    for i, drive in enumerate(config.mechanism.drives):
        endless = drive.joint in config.mechanism.wheels
        yield from _drive(f"mechanism.{drive.key(i)}", drive, joints[drive.joint], endless)
    yield from _postures(config, robot)
    yield from _gripper(config)
    yield from _payloads(config.mechanism)
    yield from camera_disagreements(config)
    yield from obstacle_disagreements(config)
    yield from mode_disagreements(config)
    yield from source_disagreements(config)
    if config.touch is not None and len(config.touch.torque) not in (1, len(robot.joints)):
        yield (
            f"touch.torque: {len(config.touch.torque)} values for {len(robot.joints)} joints: "
            "give 1 or one each"
        )
    if config.reflection is not None and config.mechanism.force_torque is None:
        yield "reflection: the cell has no [mechanism.force_torque] sensor to reflect forces of"
    yield from priority_disagreements(config, robot)
    yield from rover_disagreements(config, robot)
    if config.rig is not None:
        n = len(robot.joints)
        given = ("stiffness", "damping", "integral", "armature", "friction", "brake_torque")
        for key in given:
            count = len(getattr(config.rig.drive, key))
            if count not in (0, 1, n):
                yield f"rig.drive.{key}: {count} values: must be 1, or {n}: one per joint"


def _payloads(mechanism: MechanismSection) -> Iterator[str]:
    rated = mechanism.rated_payload
    named = {f"payloads.{name}": p for name, p in mechanism.payloads.items()}
    if mechanism.force_torque is not None:
        named["force_torque.payload"] = mechanism.force_torque.payload
    for where, payload in named.items():
        if rated is not None and payload.mass > rated:
            yield (
                f"mechanism.{where}.mass: value {payload.mass:g}: the arm is rated for {rated:g} kg"
                " (mechanism.rated_payload)"
            )


def _pairing(drives: tuple[DriveSection, ...], robot: Robot) -> Iterator[str]:
    names = [j.name for j in robot.joints]
    seen: set[str] = set()
    for i, drive in enumerate(drives):
        where = f"mechanism.{drive.key(i)}"
        if drive.joint not in names:
            hint = nearest(drive.joint, names)
            yield (
                f"{where}.joint: value '{drive.joint}': no such movable joint between base and tip "
                f"in {robot.urdf}{hint}"
            )
        if drive.joint in seen:
            yield f"{where}.joint: value '{drive.joint}': already has a drive"
        seen.add(drive.joint)
    for name in names:
        if name not in seen:
            yield f"mechanism.drives: joint '{name}' of {robot.urdf} has no drive"


def _drive(where: str, drive: DriveSection, joint: UrdfJoint, endless: bool) -> Iterator[str]:
    if drive.max_velocity > joint.velocity:
        yield (
            f"{where}.max_velocity: value {drive.max_velocity:g}: must be at most "
            f"{joint.velocity:g}, the URDF's limit of joint '{joint.name}'"
        )
    if 2 * drive.position_margin >= joint.upper - joint.lower:
        yield (
            f"{where}.position_margin: value {drive.position_margin:g}: leaves nothing of joint "
            f"'{joint.name}' ({joint.lower:g} to {joint.upper:g})"
        )
    for angle in () if endless else (joint.lower, joint.upper):
        counts = drive.direction * (angle - drive.zero_rad) * drive.counts_per_radian
        if abs(counts) > INT32_MAX:
            yield (
                f"{where}.counts_per_radian: value {drive.counts_per_radian:g}: joint "
                f"'{joint.name}' at {angle:g} would be {counts:.0f} counts, beyond the 32 bits of "
                "607Ah and 6064h"
            )


def _postures(config: CellConfig, robot: Robot) -> Iterator[str]:
    postures = config.mechanism.postures
    bounds = joint_bounds(robot.joints, config.mechanism.drives)
    for name in REQUIRED_POSTURES:
        if name not in postures:
            yield f"mechanism.postures.{name}: missing: 'start' and 'ready' are required"
    for name, q in postures.items():
        where = f"mechanism.postures.{name}"
        if len(q) != len(robot.joints):
            yield f"{where}: {len(q)} values: must be {len(robot.joints)}: one per joint"
            continue
        for i, (angle, joint, low, high) in enumerate(zip(q, robot.joints, *bounds, strict=True)):
            if not low <= angle <= high:
                yield (
                    f"{where}[{i}]: value {angle:g}: joint '{joint.name}' must be within {low:g} "
                    f"to {high:g}: the URDF's limits less position_margin"
                )

    pulled_to = config.redundancy.posture_name
    if pulled_to not in postures:
        hint = nearest(pulled_to, postures)
        yield f"redundancy.posture_name: value '{pulled_to}': no such posture{hint}"


def _gripper(config: CellConfig) -> Iterator[str]:
    mechanism = config.mechanism
    gripper = mechanism.gripper
    if gripper is None:
        return
    where = "mechanism.gripper"
    for key in ("open_payload", "closed_payload"):
        name = getattr(gripper, key)
        if name is not None and name not in mechanism.payloads:
            hint = nearest(name, list(mechanism.payloads))
            yield f"{where}.{key}: value '{name}': no such payload in mechanism.payloads{hint}"
