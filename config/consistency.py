"""Agreement between a cell's sections, and between the cell and its robot."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from .drives import joint_bounds
from .errors import ConfigError, nearest
from .schema.bus import CanOpenNodeSection, Entry
from .schema.cell import CellConfig
from .schema.mechanism import DriveSection, ForceTorqueSection, MechanismSection, TorsoSection
from .schema.surroundings import CameraSection, RigTagSection
from .urdf.robot import Robot, UrdfJoint

# --- Agreement between a cell's CAN buses and the devices on them ---------------------------------

MASTER_NODE: Final = 127
"""The daemon's own node id, which its heartbeat uses."""
_MASTER_IDS: Final = {0x000: "NMT", 0x080: "SYNC", 0x700 + MASTER_NODE: "the daemon's heartbeat"}


def bus_disagreements(
    parts: Sequence[tuple[str, CellConfig]], devices: Sequence[Entry]
) -> Iterator[str]:
    """Yield what does not fit, each in one line with its key.

    `parts` are the cell's mechanisms: each one's place in the file, and what the file says of it.
    """
    _, config = parts[0]
    if config.buses and "bus" in config.model_fields_set:
        yield "buses: there is a [bus], too: give either [bus] or [[buses]]"
    yield from _buses(config)
    names = [bus.name for bus in config.fieldbuses]
    owners: dict[tuple[str, int], str] = {}
    for name in names:
        owners |= {(name, can_id): owner for can_id, owner in _MASTER_IDS.items()}
    nodes = {(name, MASTER_NODE): "the daemon" for name in names}
    for place, part in parts:
        yield from _known(place, part.mechanism.bus, names)
    called: set[str] = set()
    for entry in devices:
        yield from _known(entry.key, entry.section.bus, names)
        if entry.name in called:
            yield f"{entry.key}.name: value '{entry.name}': another device has that name"
        called.add(entry.name)
        yield from _identifiers(entry, nodes, owners)
    yield from _without_drives(devices)


def _known(key: str, bus: str | None, names: list[str]) -> Iterator[str]:
    if bus is not None and bus not in names:
        yield f"{key}.bus: value '{bus}': no such bus in [[buses]]{nearest(bus, names)}"


def _buses(config: CellConfig) -> Iterator[str]:
    names: list[str] = []
    wires: dict[tuple[str, str, int], str] = {}
    for i, bus in enumerate(config.buses):
        if bus.name in names:
            yield f"buses[{i}].name: value '{bus.name}': is there already"
        names.append(bus.name)
        wire = (bus.interface, bus.channel, bus.port if bus.interface == "loopback" else 0)
        if wire in wires:
            yield f"buses[{i}].channel: value '{bus.place}': already that of bus '{wires[wire]}'"
        wires[wire] = bus.name


def _identifiers(
    entry: Entry, nodes: dict[tuple[str, int], str], owners: dict[tuple[str, int], str]
) -> Iterator[str]:
    """Judge one device's identifiers against those of the devices before it."""
    section = entry.section
    if isinstance(section, CanOpenNodeSection):
        place = (entry.bus, section.node)
        if place in nodes:
            yield f"{entry.key}.node: value {section.node}: already the node of {nodes[place]}"
        nodes[place] = entry.owner
    own: dict[tuple[str, int], str] = {}
    for key, can_id in section.identifiers():
        taken = owners.get((entry.bus, can_id)) or own.get((entry.bus, can_id))
        if taken is not None:
            yield f"{entry.key}.{key}: value {can_id:#x}: is already the CAN id of {taken}"
        own[entry.bus, can_id] = f"{entry.key}.{key}"
    owners |= dict.fromkeys(own, entry.owner)


def _without_drives(devices: Sequence[Entry]) -> Iterator[str]:
    """A sample is aged by the answers of a drive that shares the clock of its stamps."""
    driven = {entry.bus for entry in devices if isinstance(entry.section, DriveSection)}
    for entry in devices:
        if isinstance(entry.section, ForceTorqueSection) and entry.bus not in driven:
            yield (
                f"{entry.key}.bus: value '{entry.bus}': no drive is on that bus, whose answers "
                "tell how old a sample is"
            )


# --- Agreement between a cell's cameras, the vision source, and the tags of the rig ---------------


def camera_disagreements(config: CellConfig) -> Iterator[str]:
    """Yield what does not fit, each in one line with its key."""
    names = [c.name for c in config.cameras]
    yield from _twice("cameras", names)
    wanted = config.sources.vision.camera
    if wanted is not None and wanted not in names:
        hint = nearest(wanted, names)
        yield f"sources.vision.camera: value '{wanted}': no such camera in [[cameras]]{hint}"
    if config.sources.vision.view is not None and not names:
        yield "sources.vision.view: there is no camera in [[cameras]]"
    tags = () if config.rig is None else config.rig.tags
    yield from _twice("rig.tags", [tag.name for tag in tags])
    for i, camera in enumerate(config.cameras):
        if camera.device is None:
            yield from _rendered(f"cameras[{i}]", camera, config.rig is not None, tags)


def _rendered(
    where: str, camera: CameraSection, rig: bool, tags: tuple[RigTagSection, ...]
) -> Iterator[str]:
    if not rig:
        yield f"{where}.device: missing: without [rig] a camera is opened, not rendered"
    width, height = camera.size
    middle = (width / 2 - 0.5, height / 2 - 0.5)
    if camera.focal[0] != camera.focal[1] or camera.centre != middle or any(camera.distortion):
        yield (
            f"{where}.focal: a rendered camera is a pinhole: one focal length, the principal point "
            "in the middle, no distortion"
        )
    for tag in tags:
        if (tag.tag, tag.family) == (camera.tag, camera.family) and tag.size != camera.tag_size:
            yield f"{where}.tag_size: value {camera.tag_size:g}: rig.tags has it as {tag.size:g}"
        for i, other in enumerate(camera.board):
            if (tag.tag, tag.family) == (other.tag, camera.family) and tag.size != other.size:
                yield f"{where}.board[{i}].size: value {other.size:g}: rig.tags has {tag.size:g}"


def _twice(where: str, names: list[str]) -> Iterator[str]:
    for i, name in enumerate(names):
        if name in names[:i]:
            yield f"{where}[{i}].name: value '{name}': is there already"


# --- Needs of the drives' operation mode in the cell's other sections -----------------------------


def mode_disagreements(config: CellConfig) -> Iterator[str]:
    """Yield what does not fit, each in one line with its key."""
    mechanism = config.mechanism
    if mechanism.base is not None and mechanism.operation_mode == "cst":
        yield (
            "mechanism.operation_mode: value 'cst': the law takes Base to stand, but there is "
            "[mechanism.base]"
        )
    if mechanism.base is not None and config.potential.search:
        yield (
            f"potential.search: value {config.potential.search}: the search takes Base to stand, "
            "but there is [mechanism.base]"
        )
    if mechanism.operation_mode == "cst":
        if config.frames.base is not None:
            yield (
                "mechanism.operation_mode: value 'cst': the law takes Base to stand, but there is "
                "[frames.base]"
            )
        for i, drive in enumerate(mechanism.drives):
            if drive.max_torque_rate is None:
                yield (
                    f"mechanism.drives[{i}].max_torque_rate: missing: drives in cst need a bound "
                    f"of joint '{drive.joint}' [N·m/s]"
                )


# --- Agreement between a cell's obstacles and what may touch what ---------------------------------


def obstacle_disagreements(config: CellConfig) -> Iterator[str]:
    """Yield what does not fit, each in one line with its key."""
    names = [o.name for o in config.obstacles]
    for i, obstacle in enumerate(config.obstacles):
        if obstacle.name in names[:i]:
            yield f"obstacles[{i}].name: value '{obstacle.name}': is there already"
    avoidance = config.avoidance
    near, promised = avoidance.near_distance, avoidance.clearance + avoidance.margin
    if avoidance.near_speed is not None and near <= promised:
        yield (
            f"avoidance.near_distance: value {near:g}: must be above {promised:g}, clearance and "
            "margin"
        )


def link_disagreements(config: CellConfig, robots: Sequence[tuple[str, Robot]]) -> Iterator[str]:
    """Yield what does not fit the links of a cell's arms, each with what their names begin with."""
    if config.keeps_clear:
        shaped = {link for c in config.avoidance.capsules for link in (c.link, *c.holds)}
        for prefix, robot in robots:
            for link in robot.unshaped_links():
                if f"{prefix}{link}" not in shaped:
                    yield (
                        f"avoidance.capsules: link '{prefix}{link}' of {robot.urdf} has mass but "
                        "no <collision>: nothing would keep it clear; give it capsules here"
                    )
            for link in robot.mesh_links():
                if f"{prefix}{link}" not in shaped:
                    yield (
                        f"avoidance.capsules: link '{prefix}{link}' of {robot.urdf} has a mesh, "
                        f"which is not read: give it capsules here, as `telerobot init "
                        f"{robot.urdf}` finds them"
                    )
    links = [f"{prefix}{link}" for prefix, robot in robots for link in robot.links()]
    named = [
        (f"avoidance.capsules[{i}].link", c.link) for i, c in enumerate(config.avoidance.capsules)
    ]
    named += [
        (f"avoidance.capsules[{i}].holds[{k}]", link)
        for i, capsule in enumerate(config.avoidance.capsules)
        for k, link in enumerate(capsule.holds)
    ]
    # What a link may touch can be an obstacle that only comes while the arm works.
    contacts = enumerate(config.avoidance.allowed_contacts)
    for i, pair in contacts:
        where = f"avoidance.allowed_contacts[{i}]"
        named += [(f"{where}.link", pair.link)]
        named += [(f"{where}.other", pair.other)] if "." in pair.other else []
    for where, link in named:
        if link not in links:
            files = ", ".join(sorted({str(robot.urdf) for _, robot in robots}))
            yield f"{where}: value '{link}': no such link in {files}{nearest(link, links)}"


# --- Agreement between the parts of a cell: its mechanisms, and the buses that they share ---------


class PartOf(NamedTuple):
    """One mechanism of a cell: its place in the file, and what the file says of it."""

    place: str
    prefix: str
    """Prefix of the names of its links and devices."""
    config: CellConfig
    robot: Robot


Parts = Sequence[PartOf]


def check_cell(path: Path, parts: Parts, devices: Sequence[Entry]) -> None:
    """Raise `ConfigError`, of all disagreements found, each naming the file and the key."""
    found = list(_of_mechanism(parts, devices))
    if found:
        raise ConfigError(*(f"{path}: {text}" for text in found))


def _of_mechanism(parts: Parts, devices: Sequence[Entry]) -> Iterator[str]:
    first = parts[0].config
    yield from bus_disagreements([(p.place, p.config) for p in parts], devices)
    yield from link_disagreements(first, [(p.prefix, p.robot) for p in parts])
    yield from _standing(parts)
    yield from _cameras(parts)
    yield from _sight_lines(parts)
    yield from _rovers(parts)
    rigs = [part.config.rig is not None for part in parts]
    if any(rigs) and not all(rigs):
        place = parts[rigs.index(False)].place
        yield f"{place}.rig: missing: other mechanisms of the cell are simulated"


def _standing(parts: Parts) -> Iterator[str]:
    """Judge which mechanism stands on which."""
    on = {part.config.mechanism.name: part.config.mechanism.on for part in parts}
    for part in parts:
        place, mechanism = part.place, part.config.mechanism
        under = mechanism.on
        if under is None:
            if mechanism.T_on is not None:
                yield f"{place}.T_on: there is no {place}.on that says what it stands on"
            continue
        where = f"{place}.on: value '{under}'"
        if under not in on:
            yield f"{where}: no such mechanism{nearest(under, list(on))}"
        way = [mechanism.name]
        while (below := on.get(way[-1])) is not None and below not in way:
            way.append(below)
        if below is not None:
            yield f"{where}: goes round in a circle: {' on '.join((*way, below))}"
        elif under in on:
            yield from _on_torso(parts, part, where)
    for part in parts:
        if part.config.mechanism.torso is not None:
            yield from _torso(part, part.config.mechanism.torso)


def _on_torso(parts: Parts, part: PartOf, where: str) -> Iterator[str]:
    """Judge one mechanism that stands on another one."""
    mechanism, names = part.config.mechanism, [p.config.mechanism.name for p in parts]
    carrier = parts[names.index(mechanism.on or "")].config.mechanism
    if carrier.torso is None:
        yield f"{where}: has no [torso], so that nothing can stand on it"
    if carrier.on is not None:
        yield f"{where}: stands on '{carrier.on}' itself: one torso on another is not supported"
    first, own = names.index(carrier.name), names.index(mechanism.name)
    between = [p.config.mechanism for p in parts[min(first, own) + 1 : own]]
    if own < first or any(other.on != carrier.name for other in between):
        yield (
            f"{part.place}: value '{mechanism.name}': what stands on '{carrier.name}' comes right "
            "after it in the file"
        )
    for camera in part.config.cameras:
        if camera.on == "base":
            yield (
                f"{part.place}: camera '{camera.name}' is fixed to Base, which '{carrier.name}' "
                "moves: not supported, give it T_wrist_lens or T_world_lens"
            )
    yield from _unable(part, "stands on another")


def _torso(part: PartOf, torso: TorsoSection) -> Iterator[str]:
    """Judge one mechanism that carries others."""
    count, joints = len(torso.weight), len(part.config.mechanism.drives)
    if count not in (1, joints):
        yield f"{part.place}.torso.weight: {count} values for {joints} joints; give one or {joints}"
    if part.config.mechanism.force_torque is not None:
        yield f"{part.place}.force_torque: others stand where it measures: leave it out"
    if part.config.touch is not None:
        yield (
            f"{part.place}.touch: torques are judged by the loads of a mechanism alone, and this "
            "one carries others: switch it off, by touch = false"
        )
    yield from _unable(part, "carries others")


def _unable(part: PartOf, what: str) -> Iterator[str]:
    """Yield what a mechanism may not have that shares joints with others."""
    mechanism = part.config.mechanism
    if part.config.frames.base is not None:
        yield f"{part.place}.frames.base: not supported for a mechanism that {what}"
    for key in ("base", "gantry", "backbone", "sweep"):
        if getattr(mechanism, key) is not None:
            yield f"{part.place}.{key}: not supported for a mechanism that {what}"
    if mechanism.operation_mode == "cst":
        yield (
            f"{part.place}.operation_mode: value 'cst': the torque law knows the loads of a "
            f"mechanism alone, and this one {what}: give csp or csv"
        )


def _rovers(parts: Parts) -> Iterator[str]:
    """One base drives beside arms that stand; a scanner looks ahead of the first mechanism."""
    if len(parts) == 1:
        return
    looks = parts[0].config.scanner is not None
    for i, part in enumerate(parts):
        base = part.config.mechanism.base
        if base is not None and i > 0:
            yield (
                f"{part.place}.base: a mechanism on wheels must be the first of its cell, and the "
                "only one there: give each rover a cell of its own, and tell it of the others as "
                "obstacles"
            )
        if base is not None and base.wheels.followers and part.config.rig is not None:
            yield (
                f"{part.place}.base.wheels.followers: value {list(base.wheels.followers)}: the "
                "virtual hardware has them for the only mechanism of a cell, which has "
                f"{len(parts)}"
            )
        for key in ("scanner", "contour"):
            if i > 0 and getattr(part.config, key) is not None:
                yield f"{part.place}.{key}: looks ahead of the first mechanism of a cell only"
        if i > 0 and looks and part.config.frames.base is not None:
            yield (
                f"{part.place}.frames.base: a scanner knows the rays on this mechanism by where "
                "the cell has its Base: one that moves is not supported beside it"
            )


def _cameras(parts: Parts) -> Iterator[str]:
    """Pictures are told by the camera's name, whichever task it is of."""
    seen: dict[str, str] = {}
    for part in parts:
        name = part.config.mechanism.name
        for camera in part.config.cameras:
            if camera.name in seen:
                yield (
                    f"tasks: camera '{camera.name}' of mechanism '{name}' is also one of "
                    f"'{seen[camera.name]}': give one another name"
                )
            seen[camera.name] = name
    rig, names = parts[0].config.rig, [part.config.mechanism.name for part in parts]
    for i, tag in enumerate(() if rig is None else rig.tags):
        if tag.mechanism is not None and tag.mechanism not in names:
            hint = nearest(tag.mechanism, names)
            yield f"rig.tags[{i}].mechanism: value '{tag.mechanism}': no such mechanism{hint}"


def _sight_lines(parts: Parts) -> Iterator[str]:
    """A sight line begins at a camera of any mechanism that is carried, or stands in World."""
    cameras = {camera.name: camera for part in parts for camera in part.config.cameras}
    for i, obstacle in enumerate(parts[0].config.obstacles):
        if obstacle.camera is None:
            continue
        where = f"obstacles[{i}].camera: value '{obstacle.camera}'"
        camera = cameras.get(obstacle.camera)
        if camera is None:
            yield f"{where}: no such camera in [[cameras]]{nearest(obstacle.camera, list(cameras))}"
        elif camera.on == "base":
            yield (
                f"{where}: stands on Base: a sight line begins at a camera with T_wrist_lens or "
                "T_world_lens"
            )
        elif camera.on == "wrist" and obstacle.hard:
            yield (
                f"obstacles[{i}].hard: value True: the sight line of '{obstacle.camera}' moves "
                "with the arm: only one that begins at a standing camera can be a barrier"
            )


# --- Needs of virtual spheres in the robot and in the null space ----------------------------------


def priority_disagreements(config: CellConfig, robot: Robot) -> Iterator[str]:
    """Yield what does not fit, each in one line with its key."""
    priority = config.priority
    if priority is None:
        if config.redundancy.spheres > 0.0:
            yield (
                f"redundancy.spheres: value {config.redundancy.spheres:g}: there is no [priority], "
                "which says where the spheres are"
            )
        return
    names = [joint.name for joint in robot.joints]
    for i, name in enumerate(priority.joints):
        if name not in names:
            hint = nearest(name, names)
            yield f"priority.joints[{i}]: value '{name}': no such joint of the arm{hint}"


# --- Needs of a base on wheels, and of the contour ahead of it, in the cell's other sections ------


def rover_disagreements(config: CellConfig, robot: Robot) -> Iterator[str]:
    """Yield what does not fit, each in one line with its key."""
    yield from _news(config)
    if config.contour is None:
        return
    if config.scanner is None:
        yield "contour: there is no [scanner] that sees it"
    base = config.mechanism.base
    if base is not None and base.objectives:
        yield (
            f"mechanism.base.objectives: value '{base.objectives[0]}': a base with a [contour] "
            "ahead drives as it is asked alone, since nobody looks where else it would go"
        )
    names = [joint.name for joint in robot.joints]
    beside = config.mechanism.beside_chain
    for key in ("shoulder", "elbow"):
        name = getattr(config.contour, key)
        if name not in names or name in beside:
            arm = [each for each in names if each not in beside]
            yield f"contour.{key}: value '{name}': no such joint of the arm{nearest(name, arm)}"


def _news(config: CellConfig) -> Iterator[str]:
    """News of Base is not believed if it moves faster than `[frames.base]` says."""
    base, told = config.mechanism.base, config.frames.base
    if base is None or told is None:
        return
    drives = [d for d in config.mechanism.drives if d.joint in config.mechanism.wheels]
    rim = base.wheels.radius * max((d.max_acceleration for d in drives), default=0.0)
    for key, goes in (
        ("speed", base.speed),
        ("angular_speed", base.angular_speed),
        ("acceleration", rim),
        ("angular_acceleration", 2.0 * rim / base.wheels.turning_track),
    ):
        value = getattr(told, key)
        if value < goes:
            yield (
                f"frames.base.{key}: value {value:g}: must be at least {goes:.4g}, which its "
                "wheels do: no news of a base that drives would be believed"
            )


def _rails(mechanism: MechanismSection, robot: Robot) -> Iterator[str]:
    """Rails of a gantry, or a backbone's feed, come first in the chain, and slide."""
    key, asked = mechanism.rails
    chain = robot.joints[: len(asked)]
    first = tuple(joint.name for joint in chain)
    if asked != first:
        yield f"{key}: value {', '.join(asked)}: the chain begins with {', '.join(first)}"
    for joint in chain:
        if joint.name in asked and joint.kind != "prismatic":
            yield f"{key}: {joint.name} is {joint.kind}, prismatic is expected"


def _feed(mechanism: MechanismSection, robot: Robot) -> Iterator[str]:
    """A backbone's feed stays within its joint's range."""
    feed = None if mechanism.backbone is None else mechanism.backbone.feed
    if feed is None:
        return
    names = [joint.name for joint in robot.joints]
    if feed.joint not in names:
        return
    low, high = (x[names.index(feed.joint)] for x in joint_bounds(robot.joints, mechanism.drives))
    for key, value in (("back", feed.back), ("front", feed.front)):
        if not low <= value <= high:
            yield (
                f"mechanism.backbone.feed.{key}: value {value:g}: must be within {low:g} to "
                f"{high:g}, the range of {feed.joint}"
            )


# --- Needs of the sources in the cell's other sections --------------------------------------------


def source_disagreements(config: CellConfig) -> Iterator[str]:
    """Yield what does not fit, each in one line with its key."""
    has = {
        "force_torque": config.mechanism.force_torque is not None,
        "camera": bool(config.cameras),
        "contour": config.contour is not None,
        "base": config.frames.base is not None,
        "carrier": config.frames.carrier is not None,
    }
    there = frozenset(name for name, given in has.items() if given)
    for name, section in config.sources.each.items():
        for complaint in section.lacking(there):
            yield f"sources.{name}.{complaint}"


# --- Agreement between a cell's sections, and between the cell and its robot ----------------------

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
    if config.resolve.free_axes and config.mechanism.backbone is not None:
        yield "resolve.free_axes: an arm with a [mechanism.backbone] follows its curve: give none"
    yield from priority_disagreements(config, robot)
    yield from rover_disagreements(config, robot)
    yield from _rails(config.mechanism, robot)
    yield from _feed(config.mechanism, robot)
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
