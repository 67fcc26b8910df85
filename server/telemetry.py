"""Telemetry: a cell's state, events, reflected forces, and its description."""

import math
from importlib import metadata
from typing import Any, Final, NamedTuple

from ..config.drives import joint_bounds
from ..config.load import Cell, joint_part
from ..config.schema.joint_task import JointTaskSection
from ..config.schema.sources import SOURCES
from ..protocols.canopen.cia402 import DriveState
from ..protocols.messages.messages import VERSION, Value
from ..protocols.messages.telemetry import (
    Description,
    RecordedTick,
    State,
    TaskDescription,
    TaskState,
)
from ..protocols.topics import DESCRIPTION, EVENT, HELD, REFLECTION, STATE, TICK
from .control.bodies.rates import ArmTick
from .control.inputs import VirtualLinks
from .control.mechanism.redundancy import FieldReading, Near
from .control.spatial import Array, product
from .control.task.position import Progress
from .events import Events
from .mode import Mode
from .operators.admission import Admission
from .operators.link import Link, network
from .plant import PlantReading
from .recorder import KeptTick, pack
from .units.unit import Unit, described_base, described_insertion, described_self_motion
from .units.units import JointUnit, Units

DRIVE_WORDS: Final[dict[DriveState | None, str]] = {
    None: "unknown",
    **{state: state.name.lower() for state in DriveState},
}
"""The states of drives as operators read them."""


def describe(cell: Cell) -> Description:
    """Return the description of a cell."""
    config = cell.config
    return Description(
        **_described(cell),
        cell=config.name,
        description=config.description,
        network=network(config.zenoh),
        period_s=config.timing.period_s,
        lease_timeout_s=config.timing.lease_timeout_s,
        stream_timeout_s=config.timing.stream_timeout_s,
        max_command_age_s=config.timing.max_command_age_s,
        buses={
            bus.name: tuple(entry.name for entry in cell.devices if entry.bus == bus.name)
            for bus in config.fieldbuses
        },
        versions={"telerobot": metadata.version("telerobot"), "protocol": str(VERSION)},
        tasks=(
            *(TaskDescription(**_described(part)) for part in cell.others),
            *(TaskDescription(**_described_joint(cell, task)) for task in cell.joint_tasks),
        ),
    )


def _described(part: Cell) -> dict[str, Any]:
    """Return what is described of one arm and its task."""
    config = part.config
    drives, joints = config.mechanism.drives, part.robot.joints
    bounds = joint_bounds(joints, drives)
    slides = tuple(joint.kind == "prismatic" for joint in joints)
    return {
        "task": part.task,
        "mechanism": config.mechanism.name,
        "joints": tuple(f"{part.prefix}{j.name}" for j in joints),
        "lower": bounds.lower,
        "upper": bounds.upper,
        "slides": slides if any(slides) else (),
        "insertion": described_insertion(part),
        "base": described_base(part),
        "self_motion": described_self_motion(part),
        "max_velocity": tuple(d.max_velocity for d in drives),
        "postures": config.mechanism.postures,
        "sources": SOURCES,
        "gains": {name: section.gain for name, section in config.sources.each.items()},
    }


def _described_joint(cell: Cell, task: JointTaskSection) -> dict[str, Any]:
    """Return what is described of a task that several mechanisms hold: the first one's joints."""
    return {**_described(joint_part(cell, task)), "task": task.name, "self_motion": None}


class TickRecord(NamedTuple):
    """One tick as the cycle knows it."""

    tick: int
    time_s: float
    mode: Mode
    reading: PlantReading
    q: Array
    """Measured joints (n,) of the cell [rad]; the last ones heard while a drive is missing."""
    protective_stop: bool
    overruns: int


def snapshot(record: TickRecord, units: Units, admission: Admission) -> State | None:
    """Return the state of one tick, as operators see it; None before the first was computed."""
    reading, outputs, tasks = record.reading, [], []
    q_command: list[float] = []
    dq_command: list[float] = []
    following_error: list[float] = []
    for unit, own in zip(units.each, reading.units, strict=True):
        output = unit.output
        if output is None:
            return None
        q_command += output.motion.q.tolist()
        dq_command += output.motion.dq.tolist()
        following_error += output.error.tolist()
        outputs.append(output)
        tasks.append(_of_task(record, unit, output, own.wrench))
    beside = {
        unit.task: TaskState.of_valid(**told)
        for unit, told in zip(units.each[1:], tasks[1:], strict=True)
    }
    for joint in units.joint:
        if joint.output is not None:
            beside[joint.task] = TaskState.of_valid(**_of_task(record, joint, joint.output, None))
    return State.of_valid(
        **tasks[0],
        tick=record.tick,
        time_s=record.time_s,
        mode=str(record.mode),
        q=tuple(record.q.tolist()),
        q_command=tuple(q_command),
        dq_command=tuple(dq_command),
        tau=tuple(reading.tau.tolist()),
        following_error=tuple(following_error),
        devices={name: dict(values) for name, values in reading.values.items()},
        avoiding=units.settings.avoid,
        gaps=tuple([(g.link, g.other, g.gap, g.active) for g in outputs[0].gaps]),
        speed_factor=units.settings.speed_factor,
        drives=tuple(map(DRIVE_WORDS.get, reading.states)),
        protective_stop=record.protective_stop,
        lease_epoch=admission.lease.epoch,
        lease_holder=admission.lease.holder,
        last_seq=dict(admission.last_seq),
        command_age_ticks=admission.age_ticks,
        overruns=record.overruns,
        tasks=beside,
    )


def _of_task(
    record: TickRecord, unit: Unit | JointUnit, output: ArmTick, wrench: Array | None
) -> dict[str, Any]:
    """Return what is told of one arm and its task; `wrench` (6,) is what its sensor reads."""
    commands, perception = unit.commands, unit.perception
    vision, frames, tick = unit.vision, perception.moving_frames, record.tick
    external, passage = perception.collisions.external, perception.passage
    found, task, held, wrench_mrf = output.found, output.task, output.holding, output.wrench
    near, settings = output.near, commands.settings
    links = settings.links
    path, tunnel, payload = task.position.progress, settings.tunnel, settings.payload
    target, master, by_hand = commands.target, commands.master, commands.self_motion.goal
    poses: dict[str, Any] = {}
    ages: dict[str, int | None] = {}
    for name in frames.names:
        poses[name], ages[name] = frames.body(name).T.to_xyz_rpy(), frames.age(name, tick)
    shares: dict[str, Any] = {}
    carried: dict[str, Any] = {}
    for name, grasp in unit.grasps.items():
        shares[name] = tuple(grasp.weights.tolist())
        carried[name] = (grasp.share, grasp.carried)
    view = view_age = view_error = view_error_px = view_law = None
    if vision.watching:
        view, view_age, view_law = vision.view, vision.age(tick), vision.law
        view_error, view_error_px = vision.error, vision.error_px
    return {
        "external_torque": None if external is None else tuple(external.tolist()),
        "pose_mrf": output.T_world_mrf.to_xyz_rpy(),
        "pose_mrf_measured": output.T_world_mrf_measured.to_xyz_rpy(),
        "pose_crf": commands.frames.T_world_crf.to_xyz_rpy(),
        "ground": commands.ground(record.time_s),
        "frames": poses,
        "frame_age_ticks": ages,
        "target_mrf": None if target is None else target.to_xyz_rpy(),
        "wrench_mrf": None if wrench_mrf is None else tuple(wrench_mrf.tolist()),
        "wrench_sensor": None if wrench is None else tuple(wrench.tolist()),
        "gripper_closed": settings.gripper_closed,
        "payload": None if payload is None else (payload.mass, *payload.com.tolist()),
        "view": None if view is None else view.to_xyz_rpy(),
        "view_age_ticks": view_age,
        "view_error": view_error,
        "view_error_px": view_error_px,
        "view_law": view_law,
        "sources": {name: tuple(twist.tolist()) for name, twist in output.twists.items()},
        "gains": {name: tuple(gain.tolist()) for name, gain in task.gains.items()},
        "on": dict(settings.on),
        "twist": tuple(output.twist.tolist()),
        "self_motion": tuple(found.self_motion.dq.tolist()),
        "objectives": {
            name: (gain, found.self_motion.norms.get(name, 0.0))
            for name, gain in output.gains.gains.items()
        },
        "arm_angle": unit.arm_angle,
        "arm_angle_target": None if by_hand is None else by_hand.angle,
        "axes_held": (1.0,) * 6 if task.held is None else tuple(task.held.tolist()),
        "path": None if path is None else _numbers(path),
        "path_mrf": None if output.T_world_path is None else output.T_world_path.to_xyz_rpy(),
        "master": {
            "engaged": float(master.engaged),
            "leading": float(master.target is not None),
            "translation": master.translation,
            "rotation": master.rotation,
        },
        "scale": output.granted,
        # The last one is why a base that is driven ahead makes no headway.
        "limits": (
            (*output.limits, passage.held)
            if passage is not None and passage.held
            else output.limits
        ),
        "held_by": None if held is None else held.task,
        "internal_force": None if held is None else held.internal_force,
        "internal_moment": None if held is None else held.internal_moment,
        "shares": shares,
        "carried": carried,
        "sigma_min": found.sigma_min if math.isfinite(found.sigma_min) else -1.0,
        "potential": None if found.field is None else potential(found.field),
        "off_path": None if task.off_path is None else tuple(task.off_path.tolist()),
        "links": None if links is None else _told(links),
        "link_directions": () if links is None else links.directions,
        "link_offs": ()
        if task.off_path is None
        else tuple(product(found.links, task.off_path).tolist()),
        "spheres": {} if near is None else sphere_distances(near),
        "priority": None if near is None else near.alpha,
        "insertion": unit.arm.body.telemetry(found.insertion),
        "tunnel": None if tunnel is None else tunnel.pieces,
        "tunnel_open": 0 if tunnel is None else tunnel.open,
        "at_goal": output.at_goal or commands.goals.posture_reached,
    }


def _told(links: VirtualLinks) -> dict[str, Value]:
    """Return how virtual links are set, but for their directions."""
    return {"axes": links.axes, "always": links.always, "stiffness": links.stiffness}


class Telemetry:
    """Publishes what one cell's daemon tells."""

    def __init__(self, description: Description, link: Link, events: Events) -> None:
        self._link, self._events = link, events
        self._description = description
        self._describe_every = DESCRIPTION.every(description.period_s)
        self._state_every = STATE.every(description.period_s)
        self._described = False
        """Somebody listened to descriptions a tick ago."""

    def publish_events(self) -> None:
        """Send the events since the last call."""
        for event in self._events.take():
            self._link.publish(EVENT, event)

    def publish_tick(self, row: KeptTick) -> None:
        """Send what a tick looked at and decided, while somebody listens."""
        if self._link.heard(TICK):
            try:
                memory = b"" if row.memory is None else pack(row.memory)
            except TypeError:  # a value that cannot be recorded: the arm goes on all the same
                memory = b""
            told = RecordedTick.of_valid(
                tick=row.tick, stamp_ns=row.stamp_ns, data=row.data, memory=memory
            )
            self._link.publish(TICK, told)

    def publish(self, record: TickRecord, units: Units, admission: Admission) -> None:
        """Send a tick's state, forces for handles, obstacles, and now and then the description.

        What nobody listens to is not computed either, and a state at most as often as its topic
        says, however short the period. The first who listens has the description at once.
        """
        heard = self._link.heard
        if heard(STATE) and record.tick % self._state_every == 0:
            state = snapshot(record, units, admission)
            if state is not None:
                self._link.publish(STATE, state)
        if heard(REFLECTION):
            for unit in units.each:
                reflector = unit.commands.reflector
                if reflector is not None:
                    reflection = reflector.message(record.tick)
                    if len(units.each) > 1:
                        reflection = reflection.model_copy(update={"task": unit.task})
                    self._link.publish(REFLECTION, reflection)
        if heard(HELD):
            for news in units.obstacles.told(record.tick):
                self._link.publish(HELD, news)
        before, self._described = self._described, heard(DESCRIPTION)
        due = record.tick % self._describe_every == 1  # a tick after the state's
        if self._described and (due or not before):
            self._link.publish(DESCRIPTION, self._description)


def potential(reading: FieldReading) -> dict[str, float]:
    """Return the potentials [J], and what is left of their slope in the self-motions [N·m]."""
    return {**reading.parts, "slope": reading.slope}


def sphere_distances(near: Near) -> dict[str, float]:
    """Return how far each virtual sphere's centre is from the nearest obstacle [m], if any."""
    each = zip(near.names, near.distances.each.tolist(), strict=True)
    return {name: distance for name, distance in each if math.isfinite(distance)}


def _numbers(path: Progress) -> dict[str, float]:
    return {
        "leg": float(path.leg),
        "legs": float(path.legs),
        "part": path.part,
        "pace": path.pace,
    }
