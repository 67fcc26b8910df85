"""Inputs of a task's sources in one tick, and telemetry of its goal."""

import math
from functools import partial

from ..mechanism.kinematics import Kinematics
from ..mechanism.null_space.priority import Near
from ..mechanism.wrist import SensorReading, Wrist, WristMemory
from ..spatial import Array, Pose, sizes
from ..state import Inputs, Intent
from ..task.asked import Asked
from ..task.gains import Quantities
from ..task.source import Context


def sample_of(inputs: Inputs) -> SensorReading:
    """Return the tick's reading of the force/torque sensor."""
    return SensorReading(inputs.wrench_sensor, inputs.wrench_age_s, inputs.wrench_mean)


def context_of(
    dq: Array,
    off_path: Array | None,
    told: WristMemory,
    near: Near | None,
    inputs: Inputs,
    k: Kinematics,
    wrist: Wrist,
    lever: Array,
    wrench: Array | None,
    hand: Array | None,
) -> Context:
    """Return what the sources see; `near` is what is near the control points now.

    Joints are commanded to go at `dq` (n,) [rad/s], the virtual link has the tool `off_path` (3,)
    [m], `told` is what the sensor of the `wrist` told. `lever` (3,) leads from the MRF to where it
    was at start [m]; `wrench` and `hand` (6,) are what the arm exerts, at and in the MRF, of the
    newest and of the mean readings.
    """
    settings, moving, moved = inputs.settings, inputs.intent is Intent.MOVE, inputs.moved
    mrf, led = settings.T_wrist_mrf, inputs.T_wrist_goal
    asked = Asked(
        T_wrist_mrf=mrf,
        T_world_crf=settings.T_world_crf,
        redefined=settings.redefined,
        ground=inputs.ground,
        speed_factor=settings.speed_factor,
        stick=inputs.stick,
        goal=inputs.goal if moving and inputs.posture is None else None,
        T_wrist_goal=mrf if led is None else led,
        paused=inputs.paused,
        view=inputs.view,
        wrench_desired=inputs.wrench_desired,
        R_world_wrench=inputs.R_world_wrench,
    )
    return Context(
        asked=asked,
        moving=moving,
        guided=moving and inputs.posture is None and inputs.jog is None,
        holding=inputs.intent is Intent.HOLD,
        T_world_wrist=k.T_world_wrist,
        T_world_mrf=k.T_world_mrf,
        twist=k.J.dot(dq),
        lever=lever,
        moved=moved,
        ground=None if moved is None else moved.body(inputs.ground),
        carried=None if moved is None else moved.carries(inputs.ground, k.T_world_mrf.p),
        wrench=wrench,
        hand=hand,
        wrench_at=partial(wrist.wrench_mrf, told),
        load=told.load,
        precedence=0.0 if near is None else near.alpha,
        off_path=off_path,
        untold=settings.untold,
    )


def quantities(wrist: WristMemory, inputs: Inputs, k: Kinematics, time_s: float) -> Quantities:
    """Return what gains may depend on."""
    wrench = wrist.wrench.wrench
    target = None if inputs.goal is None else _in_world(inputs, inputs.goal.T_world_target)
    way = None
    if target is not None:
        led = inputs.T_wrist_goal
        way = target.p - (k.T_world_mrf if led is None else k.T_world_wrist @ led).p
    return Quantities(
        contact_force=None if wrench is None else sizes(wrench)[0],
        distance=None if way is None else math.sqrt(float(way @ way)),
        time=time_s,
    )


def path_of_mrf(inputs: Inputs, T: Pose | None) -> Pose | None:
    """Return where the path has the MRF in World, from where it has the point that it leads."""
    T, led = _in_world(inputs, T), inputs.T_wrist_goal
    if T is None or led is None:
        return T
    return T @ (led.inverse() @ inputs.settings.T_wrist_mrf)


def _in_world(inputs: Inputs, T: Pose | None) -> Pose | None:
    """Return where a pose on the present ground is in World."""
    ground = None if inputs.moved is None else inputs.moved.body(inputs.ground)
    return T if ground is None or T is None else ground.T @ T
