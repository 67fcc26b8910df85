"""Telemetry: the state of every tick, events, reflected forces, and a description of the cell."""

import math
from importlib import metadata
from typing import NamedTuple

from ..config.joint_bounds import joint_bounds
from ..config.load import Cell
from ..config.schema.sources.sources import SOURCES
from ..protocols.codec import encode
from ..protocols.messages.messages import VERSION, Description, State, Vector6
from ..protocols.topics import DESCRIPTION, EVENT, REFLECTION, STATE
from .commands.commands import Commands
from .control.mechanism.null_space.potential_field import FieldReading
from .control.mechanism.null_space.priority import Near
from .control.mechanism.payload import Payload
from .control.spatial import Array
from .control.state import Output
from .control.task.paths.leading import Progress
from .mode import Mode
from .operators.admission import Admission
from .operators.exposure import network
from .operators.link import Link
from .perception.perception import Perception
from .plant import PlantReading
from .runtime.events import Events

DESCRIBE_EVERY = 100
"""Ticks between two descriptions, for operators that come late [1]."""


def describe(cell: Cell) -> Description:
    """Return the description of a cell."""
    config = cell.config
    drives = config.mechanism.drives
    joints = cell.robot.joints
    bounds = joint_bounds(joints, drives)
    return Description(
        cell=config.name,
        description=config.description,
        network=network(config.zenoh),
        period_s=config.timing.period_s,
        joints=tuple(j.name for j in joints),
        lower=bounds.lower,
        upper=bounds.upper,
        max_velocity=tuple(d.max_velocity for d in drives),
        postures=config.mechanism.postures,
        sources=SOURCES,
        gains={name: section.gain for name, section in config.sources.each.items()},
        lease_timeout_s=config.timing.lease_timeout_s,
        stream_timeout_s=config.timing.stream_timeout_s,
        max_command_age_s=config.timing.max_command_age_s,
        buses={
            bus.name: tuple(entry.name for entry in cell.devices if entry.bus == bus.name)
            for bus in config.fieldbuses
        },
        versions={"telerobot": metadata.version("telerobot"), "protocol": str(VERSION)},
    )


class TickRecord(NamedTuple):
    """One tick as the cycle knows it."""

    tick: int
    time_s: float
    mode: Mode
    reading: PlantReading
    q: Array
    """Measured joints (n,) [rad]; the last ones heard while a drive is missing."""
    output: Output
    protective_stop: bool
    overruns: int


def snapshot(
    record: TickRecord, commands: Commands, perception: Perception, admission: Admission
) -> State:
    """Return the state of one tick, as operators see it."""
    reading, output = record.reading, record.output
    vision, frames, external = (
        perception.vision,
        perception.moving_frames,
        perception.collisions.external,
    )
    view, tick = vision.view, record.tick
    return State.model_construct(
        tick=tick,
        time_s=record.time_s,
        mode=str(record.mode),
        q=tuple(record.q.tolist()),
        q_command=tuple(output.q.tolist()),
        dq_command=tuple(output.dq.tolist()),
        tau=tuple(reading.tau.tolist()),
        external_torque=None if external is None else tuple(external.tolist()),
        following_error=tuple(output.following_error.tolist()),
        pose_mrf=output.T_world_mrf.to_xyz_rpy(),
        pose_mrf_measured=output.T_world_mrf_measured.to_xyz_rpy(),
        pose_crf=commands.frames.T_world_crf.to_xyz_rpy(),
        ground=commands.ground(record.time_s),
        frames={name: frames.body(name).T.to_xyz_rpy() for name in frames.names},
        frame_age_ticks={name: frames.age(name, tick) for name in frames.names},
        target_mrf=None if commands.target is None else commands.target.to_xyz_rpy(),
        wrench_mrf=None if output.wrench_mrf is None else _six(output.wrench_mrf),
        wrench_sensor=None if reading.wrench is None else _six(reading.wrench),
        devices={name: dict(values) for name, values in reading.values.items()},
        gripper_closed=commands.settings.gripper_closed,
        payload=None if commands.settings.payload is None else _four(commands.settings.payload),
        view=None if view is None else view.to_xyz_rpy(),
        view_age_ticks=vision.age(tick),
        sources={name: _six(twist) for name, twist in output.twists.items()},
        gains={name: _six(gain) for name, gain in output.gains.items()},
        on=dict(commands.settings.on),
        twist=_six(output.twist),
        self_motion=tuple(output.self_motion.dq.tolist()),
        objectives={
            name: (gain, output.self_motion.norms.get(name, 0.0))
            for name, gain in output.objectives.gains.items()
        },
        path=None if output.path is None else _numbers(output.path),
        path_mrf=None if output.T_world_path is None else output.T_world_path.to_xyz_rpy(),
        master={
            "engaged": float(commands.master.engaged),
            "leading": float(commands.master.target is not None),
            "translation": commands.master.translation,
            "rotation": commands.master.rotation,
        },
        scale=output.scale,
        limits=output.limits,
        sigma_min=output.sigma_min if math.isfinite(output.sigma_min) else -1.0,
        potential=None if output.field is None else potential(output.field),
        off_path=None if output.off_path is None else _three(output.off_path),
        avoiding=commands.settings.avoid,
        spheres={} if output.near is None else sphere_distances(output.near),
        priority=None if output.near is None else output.near.alpha,
        gaps=tuple((g.link, g.other, g.gap, g.active) for g in output.gaps),
        at_goal=output.at_goal or commands.goals.posture_reached,
        speed_factor=commands.settings.speed_factor,
        drives=tuple("unknown" if s is None else s.name.lower() for s in reading.states),
        protective_stop=record.protective_stop,
        lease_epoch=admission.lease.epoch,
        lease_holder=admission.lease.holder,
        last_seq=dict(admission.last_seq),
        command_age_ticks=admission.age_ticks,
        overruns=record.overruns,
    )


class Telemetry:
    """Publishes what one cell's daemon tells."""

    def __init__(self, description: Description, link: Link, events: Events) -> None:
        self._description, self._link, self._events = description, link, events

    def publish_events(self) -> None:
        """Send the events since the last call."""
        for event in self._events.take():
            self._link.publish(EVENT, encode(event))

    def publish(
        self, record: TickRecord, commands: Commands, perception: Perception, admission: Admission
    ) -> None:
        """Send the state of a tick, the force for the handle, and now and then the description."""
        state = snapshot(record, commands, perception, admission)
        self._link.publish(STATE, encode(state))
        reflection = commands.handle.message(record.tick)
        if reflection is not None:
            self._link.publish(REFLECTION, encode(reflection))
        if record.tick % DESCRIBE_EVERY == 1:
            self._link.publish(DESCRIPTION, encode(self._description))


def potential(reading: FieldReading) -> dict[str, float]:
    """Return the potentials [J], and what is left of their slope in the self-motions [N·m]."""
    return {**reading.parts, "slope": reading.slope}


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
