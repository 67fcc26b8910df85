"""Telemetry: the state of every tick, events, reflected forces, and a description of the cell."""

import math
from importlib import metadata
from typing import Any, NamedTuple

from ..config.drives import joint_bounds
from ..config.load import Cell, joint_part
from ..config.schema.joint_task import JointTaskSection
from ..config.schema.sources import SOURCES
from ..protocols.messages.messages import VERSION, Vector6
from ..protocols.messages.telemetry import (
    Description,
    RecordedTick,
    State,
    TaskDescription,
    TaskState,
)
from ..protocols.topics import DESCRIPTION, EVENT, HELD, REFLECTION, STATE, TICK
from .control.inputs import Payload
from .control.mechanism.field import FieldReading
from .control.mechanism.redundancy import Near
from .control.spatial import Array
from .control.state import Output
from .control.task.position import Progress
from .events import Events
from .mode import Mode
from .operators.admission import Admission
from .operators.link import Link, network
from .perception.ahead import Passage
from .plant import PlantReading
from .recorder import KeptTick, pack
from .units.unit import Unit, described_base, described_insertion, described_self_motion
from .units.units import JointUnit, Units

DESCRIBE_EVERY_S = 0.2
"""Time between two descriptions, for operators that come late [s]."""


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
    outputs = [unit.output for unit in units.each if unit.output is not None]
    if len(outputs) < len(units.each):
        return None
    reading = record.reading
    tasks = [
        _of_task(record, unit, output, own.wrench)
        for unit, output, own in zip(units.each, outputs, reading.units, strict=True)
    ]
    return State.of_valid(
        **tasks[0],
        tick=record.tick,
        time_s=record.time_s,
        mode=str(record.mode),
        q=tuple(record.q.tolist()),
        q_command=tuple(x for output in outputs for x in output.q.tolist()),
        dq_command=tuple(x for output in outputs for x in output.dq.tolist()),
        tau=tuple(reading.tau.tolist()),
        following_error=tuple(x for output in outputs for x in output.seen.error.tolist()),
        devices={name: dict(values) for name, values in reading.values.items()},
        avoiding=units.settings.avoid,
        gaps=tuple((g.link, g.other, g.gap, g.active) for g in outputs[0].gaps),
        speed_factor=units.settings.speed_factor,
        drives=tuple("unknown" if s is None else s.name.lower() for s in reading.states),
        protective_stop=record.protective_stop,
        lease_epoch=admission.lease.epoch,
        lease_holder=admission.lease.holder,
        last_seq=dict(admission.last_seq),
        command_age_ticks=admission.age_ticks,
        overruns=record.overruns,
        tasks={
            unit.task: TaskState.of_valid(**told)
            for unit, told in zip(units.each[1:], tasks[1:], strict=True)
        }
        | {
            joint.task: TaskState.of_valid(**_of_task(record, joint, joint.output, None))
            for joint in units.joint
            if joint.output is not None
        },
    )


def _of_task(
    record: TickRecord, unit: Unit | JointUnit, output: Output, wrench: Array | None
) -> dict[str, Any]:
    """Return what is told of one arm and its task; `wrench` (6,) is what its sensor reads."""
    commands, perception = unit.commands, unit.perception
    vision, frames, external = (
        unit.vision,
        perception.moving_frames,
        perception.collisions.external,
    )
    view, tick = vision.view, record.tick
    found, path = output.desired.found, output.task.position.progress
    tunnel = commands.settings.tunnel
    return {
        "external_torque": None if external is None else tuple(external.tolist()),
        "pose_mrf": output.T_world_mrf.to_xyz_rpy(),
        "pose_mrf_measured": output.T_world_mrf_measured.to_xyz_rpy(),
        "pose_crf": commands.frames.T_world_crf.to_xyz_rpy(),
        "ground": commands.ground(record.time_s),
        "frames": {name: frames.body(name).T.to_xyz_rpy() for name in frames.names},
        "frame_age_ticks": {name: frames.age(name, tick) for name in frames.names},
        "target_mrf": None if commands.target is None else commands.target.to_xyz_rpy(),
        "wrench_mrf": None if output.seen.wrench is None else _six(output.seen.wrench),
        "wrench_sensor": None if wrench is None else _six(wrench),
        "gripper_closed": commands.settings.gripper_closed,
        "payload": None if commands.settings.payload is None else _four(commands.settings.payload),
        "view": None if view is None else view.to_xyz_rpy(),
        "view_age_ticks": vision.age(tick),
        "view_error": vision.error,
        "sources": {name: _six(twist) for name, twist in output.desired.twists.items()},
        "gains": {name: _six(gain) for name, gain in output.task.gains.items()},
        "on": dict(commands.settings.on),
        "twist": _six(output.desired.twist),
        "self_motion": tuple(found.self_motion.dq.tolist()),
        "objectives": {
            name: (gain, found.self_motion.norms.get(name, 0.0))
            for name, gain in output.objectives.gains.items()
        },
        "arm_angle": unit.arm_angle,
        "arm_angle_target": commands.self_motion.target,
        "axes_held": (1.0,) * 6 if output.task.held is None else _six(output.task.held),
        "path": None if path is None else _numbers(path),
        "path_mrf": None if output.T_world_path is None else output.T_world_path.to_xyz_rpy(),
        "master": {
            "engaged": float(commands.master.engaged),
            "leading": float(commands.master.target is not None),
            "translation": commands.master.translation,
            "rotation": commands.master.rotation,
        },
        "scale": output.scale,
        "limits": output.limits + _held(perception.passage),
        "held_by": None if output.held is None else output.held.task,
        "internal_force": None if output.held is None else output.held.internal_force,
        "internal_moment": None if output.held is None else output.held.internal_moment,
        "shares": {name: _six(held.weights) for name, held in unit.grasps.items()},
        "carried": {name: (held.share, held.carried) for name, held in unit.grasps.items()},
        "sigma_min": found.sigma_min if math.isfinite(found.sigma_min) else -1.0,
        "potential": None if found.field is None else potential(found.field),
        "off_path": None if output.task.off_path is None else _three(output.task.off_path),
        "spheres": {} if output.seen.near is None else sphere_distances(output.seen.near),
        "priority": None if output.seen.near is None else output.seen.near.alpha,
        "insertion": unit.arm.body.telemetry(found.insertion),
        "tunnel": None if tunnel is None else tunnel.pieces,
        "tunnel_open": 0 if tunnel is None else tunnel.open,
        "at_goal": output.at_goal or commands.goals.posture_reached,
    }


class Telemetry:
    """Publishes what one cell's daemon tells."""

    def __init__(self, description: Description, link: Link, events: Events) -> None:
        self._link, self._events = link, events
        self._description = description
        self._describe_every = max(1, round(DESCRIBE_EVERY_S / description.period_s))
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

        What nobody listens to is not computed either. The first who listens has the description
        at once, others within `DESCRIBE_EVERY_S`.
        """
        heard = self._link.heard
        if heard(STATE) and (state := snapshot(record, units, admission)) is not None:
            self._link.publish(STATE, state)
        if heard(REFLECTION):
            for unit in units.each:
                reflection = unit.commands.handle.message(record.tick)
                if reflection is not None:
                    if len(units.each) > 1:
                        reflection = reflection.model_copy(update={"task": unit.task})
                    self._link.publish(REFLECTION, reflection)
        if heard(HELD):
            for news in units.obstacles.told(record.tick):
                self._link.publish(HELD, news)
        before, self._described = self._described, heard(DESCRIPTION)
        if self._described and (not before or record.tick % self._describe_every == 0):
            self._link.publish(DESCRIPTION, self._description)


def potential(reading: FieldReading) -> dict[str, float]:
    """Return the potentials [J], and what is left of their slope in the self-motions [N·m]."""
    return {**reading.parts, "slope": reading.slope}


def _held(passage: Passage | None) -> tuple[str, ...]:
    """Return why a base that is driven ahead makes no headway, if so, as the name of a limit."""
    return () if passage is None or not passage.held else (passage.held,)


def sphere_distances(near: Near) -> dict[str, float]:
    """Return how far each virtual sphere's centre is from the nearest obstacle [m], if any."""
    each = zip(near.names, near.distances.each.tolist(), strict=True)
    return {name: distance for name, distance in each if math.isfinite(distance)}


def _three(values: Array) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return (x, y, z)


def _four(payload: Payload) -> tuple[float, float, float, float]:
    x, y, z = payload.com.tolist()
    return (payload.mass, x, y, z)


def _numbers(path: Progress) -> dict[str, float]:
    return {
        "leg": float(path.leg),
        "legs": float(path.legs),
        "part": path.part,
        "pace": path.pace,
    }


def _six(values: Array) -> Vector6:
    a, b, c, d, e, f = values.tolist()
    return (a, b, c, d, e, f)
