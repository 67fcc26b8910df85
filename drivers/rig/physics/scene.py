"""Builds the MuJoCo model of a cell: the arm's URDF, then what `[rig]` puts around it."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....config.load import Cell, ConfigError
from ....config.schema.mechanism import MechanismSection
from ....config.schema.rig import RigSection, WallSection
from ....config.schema.section import PoseSection
from ....config.urdf.robot import axle_of
from .beam import add_beam
from .bodies import add_bridge, add_hole, add_peg, add_person, add_solid, add_tunnel, attitude
from .clearance import TOOL_BALL, WALL, add_probe
from .geoms import (
    FIXED,
    SOLREF,
    add_capsules,
    bound_contacts,
    exclude_contacts,
    fixed,
    give_mass,
    of_arm,
    quaternion,
    slides_on,
)
from .movers import add_floor, put_on_wheels

WALL_SLIDE = "wall_slide"
"""Joint of the wall's plate: its travel along the wall's normal [m]."""

PLATFORM = tuple(f"platform_{axis}" for axis in ("x", "y", "z", "roll", "pitch", "yaw"))
"""Joints of what the arm stands on, where that may move; before the arm's own."""

HELD = "held"
"""Body of what the gripper holds, at the sensor's site."""

WORLD = "world"
ROOT = "world_link"
"""The root of an arm that calls it as MuJoCo does its own."""
_LOCK_SOLREF = (0.002, 1.0)
_LOCK_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""A closed brake gives way by microradians: MuJoCo's constraints are springs, this one is hard."""
_END_STOP = 0.2
"""A joint's mechanical end stop lies this far beyond its limit in the URDF, a soft one [rad]."""
_PLATE_HALF_THICKNESS = 0.02
NEIGHBOURS = 2
"""Links that so many joints part, or fewer, may overlap: shoulders and wrists do by design [1]."""
POINT_INERTIA = 2e-4
"""About each axis of the payload's centre of mass, per kilogram [m²]."""


def build_model(cell: Cell) -> tuple[mujoco.MjModel, frozenset[int]]:
    """Return the compiled model, and the ids of the geoms that are not the arm's.

    The arm's joints come first, but for those of a platform that it stands on, with one torque
    motor (gain 1) and one joint lock (equality constraint, off) each, in the order of the drives.
    Site `mrf` is the MRF, site `sensor` the force/torque sensor. Raises `ConfigError` where the
    physics cannot be made of the cell and its URDF.
    """
    try:
        model = build_spec(cell).compile()
    except ValueError as error:
        words = str(error).removeprefix("Error: ").removeprefix("XML Error: ")
        raise ConfigError(
            f"{cell.path}: rig: no physics can be made of {cell.robot.urdf}: {words}"
        ) from None
    bound_contacts(model)
    fixed = [g for g in range(model.ngeom) if model.geom_contype[g] == FIXED]
    return model, frozenset(fixed)


def build_spec(cell: Cell) -> mujoco.MjSpec:
    """Return what `build_model` compiles, for whoever adds to it. Raises `ValueError`."""
    rig = cell.config.rig
    if rig is None:
        raise ValueError(f"cell {cell.config.name} has no [rig]: nothing to simulate")
    spec = mujoco.MjSpec() if cell.prefix else _arm_of(cell)
    for part, under in zip(cell.parts, cell.carriers, strict=True) if cell.prefix else ():
        _attach(spec, part, cell.parts[under] if under >= 0 else None)
    if cell.prefix:
        exclude_contacts(spec, cell)
        _exclude_across(spec, cell)
    spec.option.timestep = rig.physics_step_s
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10
    if cell.config.mechanism.base is not None:
        add_floor(spec)
    elif cell.config.frames.base is not None:
        _put_on_platform(spec, spec.worldbody.first_body(), rig.frames.platform_mass)
    surfaces = [] if rig.wall is None else [_add_wall(spec, rig.wall)]
    for box in rig.boxes:
        body = spec.worldbody.add_body(
            name=box.name, pos=box.xyz, quat=quaternion(PoseSection(rpy=box.rpy))
        )
        surfaces.append(_add_fixed_box(body, f"{box.name}_box", box.half_size))
    for part, prefix in zip(cell.parts, prefixes(cell), strict=True):
        if part.config.rig is not None and part.config.rig.tool_radius > 0:
            for surface in surfaces:
                slides_on(spec, prefix + TOOL_BALL, surface)
    for part in cell.parts:
        if part.config.mechanism.backbone is not None and part.config.rig is not None:
            add_tunnel(spec, part)
    for hole in rig.holes:
        add_hole(spec, hole)
    if rig.beam is not None:
        add_beam(spec, rig.beam)
    for obstacle in cell.config.obstacles:
        solid = add_solid(spec, obstacle, quaternion(attitude(obstacle)))
        if solid is not None:
            fixed(solid)
    if rig.bridge is not None:
        add_bridge(spec, rig.bridge)
    if rig.person is not None:
        add_person(spec, rig.person)
    if cell.cameras:
        add_probe(spec)
    return spec


def prefixes(cell: Cell) -> tuple[str, ...]:
    """Return what the names of each mechanism begin with in the model: nothing for the only one."""
    return tuple(part.prefix for part in cell.parts)


def _attach(spec: mujoco.MjSpec, part: Cell, under: Cell | None) -> None:
    """Add one arm of several: in World, or on the tip link of another."""
    arm, on, place = _arm_of(part), spec.worldbody, PoseSection()
    if under is not None:
        on, place = (
            spec.body(under.prefix + under.config.mechanism.tip_link),
            part.config.mechanism.T_on or place,
        )
        root = arm.worldbody.first_body()
        root.pos[:], root.quat[:] = place.xyz, quaternion(place)
    spec.attach(arm, prefix=part.prefix, frame=on.add_frame())


def _arm_of(part: Cell) -> mujoco.MjSpec:
    """Return one arm with its drives, sensor and tool, its root where its Base is in World."""
    mechanism, rig = part.config.mechanism, part.config.rig
    if rig is None:
        raise ValueError(f"cell {part.config.name} has no [rig]: nothing to simulate")
    # MuJoCo takes a link called "world" for its own, with no place that could be given.
    named = ROOT if WORLD in part.robot.links() else None
    arm = mujoco.MjSpec.from_string(part.robot.description(named))
    arm.compiler.fusestatic = False
    add_capsules(arm, part)
    exclude_contacts(arm, part)
    _furnish_arm(arm, mechanism, rig)
    if mechanism.base is not None:
        axles = {name: axle_of(part.robot, name) for name in mechanism.base.wheels.followers}
        put_on_wheels(arm, mechanism.base, mechanism.T_world_base.xyz[2], axles)
    root = arm.worldbody.first_body()
    root.pos[:], root.quat[:] = mechanism.T_world_base.xyz, quaternion(mechanism.T_world_base)
    return arm


def _put_on_platform(spec: mujoco.MjSpec, root: mujoco.MjsBody, mass: float) -> None:
    """Let the arm's root slide along and turn about the axes of its place, where it is told to."""
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    root.mass, root.explicitinertial, root.gravcomp = mass, True, 1
    root.inertia[:] = [0.5 * mass] * 3
    back = np.zeros(4)
    mujoco.mju_negQuat(back, root.quat)
    for i, name in enumerate(PLATFORM):
        axis = np.zeros(3)
        axis[i % 3] = 1.0
        if i < 3:  # slides are along World's axes, whatever the place's attitude
            mujoco.mju_rotVecQuat(axis, axis.copy(), back)
        root.add_joint(name=name, type=slide if i < 3 else hinge, axis=axis)
        hold = spec.add_equality(
            name=name,
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=name,
            active=True,
        )
        hold.solref[:], hold.solimp[:] = _LOCK_SOLREF, _LOCK_SOLIMP


def turned_by(turn: NDArray[np.float64], quat: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the rotation matrix (3, 3) of a quaternion turned by a rotation vector (3,) [rad]."""
    angle = float(np.linalg.norm(turn))
    by, both, R = np.zeros(4), np.zeros(4), np.zeros(9)
    mujoco.mju_axisAngle2Quat(by, turn / max(angle, 1e-12), angle)
    mujoco.mju_mulQuat(both, by, np.array(quat))
    mujoco.mju_quat2Mat(R, both)
    return R.reshape(3, 3)


def _furnish_arm(arm: mujoco.MjSpec, mechanism: MechanismSection, rig: RigSection) -> None:
    tip = arm.body(mechanism.tip_link)
    if tip is None:
        raise ValueError(f"tip_link {mechanism.tip_link} is not a link of {mechanism.urdf}")
    n = len(mechanism.drives)
    for geom in arm.geoms:
        of_arm(geom)
        # A link weighs what its URDF or the cell says; one that is fixed to World, whatever.
        if geom.parent.parent.name != WORLD or mechanism.on is not None:
            geom.density = 0.0
    for i, drive in enumerate(mechanism.drives):
        joint = arm.joint(drive.joint)
        if joint is None:
            raise ValueError(f"drive {drive.node}: {mechanism.urdf} has no joint {drive.joint}")
        joint.armature = _of_joint(rig.drive.armature, i, n)
        joint.frictionloss = _of_joint(rig.drive.friction, i, n)
        joint.solref_friction[:], joint.solimp_friction[:] = SOLREF, _LOCK_SOLIMP
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        joint.range[:] += -_END_STOP, _END_STOP
        motor = arm.add_actuator(
            name=drive.joint, target=drive.joint, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        motor.set_to_motor()
        lock = arm.add_equality(
            name=f"{drive.joint}_lock",
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=drive.joint,
            active=False,
        )
        lock.solref[:], lock.solimp[:] = _LOCK_SOLREF, _LOCK_SOLIMP
    _exclude_neighbours(arm)
    give_mass(arm)
    mrf = mechanism.T_wrist_mrf
    tip.add_site(name="mrf", pos=mrf.xyz, quat=quaternion(mrf))
    if rig.tool_radius > 0:
        ball = tip.add_geom(
            name=TOOL_BALL, type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=mrf.xyz, density=0
        )
        ball.size[0] = rig.tool_radius
        of_arm(ball)
    if rig.peg is not None:
        add_peg(tip, mrf, rig.peg)
    _add_sensor(arm, tip, mechanism, rig)


def _add_sensor(
    arm: mujoco.MjSpec, tip: mujoco.MjsBody, mechanism: MechanismSection, rig: RigSection
) -> None:
    sensor = mechanism.force_torque
    place = sensor.T_wrist_sensor if sensor is not None else PoseSection()
    if rig.force_torque.mounting_rpy is not None:
        place = PoseSection(xyz=place.xyz, rpy=rig.force_torque.mounting_rpy)
    tip.add_site(name="sensor", pos=place.xyz, quat=quaternion(place))
    for kind in (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE):
        arm.add_sensor(
            name=kind.name.lower(), type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="sensor"
        )
    if mechanism.gripper is not None:
        _add_held(tip, place)
    if rig.payload_mass > 0:
        body = tip.add_body(name="payload", pos=place.xyz, quat=quaternion(place))
        body.mass, body.ipos, body.explicitinertial = rig.payload_mass, rig.payload_com, True
        body.inertia = [POINT_INERTIA * rig.payload_mass] * 3


def _add_held(tip: mujoco.MjsBody, place: PoseSection) -> None:
    """Add what a gripper may hold: without mass until it does."""
    body = tip.add_body(name=HELD, pos=place.xyz, quat=quaternion(place))
    body.explicitinertial = True


def _exclude_neighbours(arm: mujoco.MjSpec) -> None:
    """Links two joints apart or less may overlap: shoulders and wrists do by design."""
    moving: dict[str, int] = {}
    for body in arm.bodies[1:]:
        above = moving.get(body.parent.name, 0)
        moving[body.name] = above + (1 if body.joints else 0)
    known = {frozenset((e.bodyname1, e.bodyname2)) for e in arm.excludes}
    for first, depth in moving.items():
        for second, deeper in moving.items():
            near = abs(depth - deeper) <= NEIGHBOURS and frozenset((first, second)) not in known
            if first < second and near:
                arm.add_exclude(bodyname1=first, bodyname2=second)


def _exclude_across(spec: mujoco.MjSpec, cell: Cell) -> None:
    """Links of two mechanisms, one on the other or both on a third, likewise: of one tree."""
    carriers = cell.carriers
    trees = [i if under < 0 else under for i, under in enumerate(carriers)]
    joints: dict[str, frozenset[str]] = {}
    of: dict[str, int] = {}
    for body in spec.bodies[1:]:
        above = joints.get(body.parent.name, frozenset())
        joints[body.name] = above | {joint.name for joint in body.joints}
        owner = [i for i, p in enumerate(cell.parts) if body.name.startswith(p.prefix)]
        of[body.name] = owner[0] if owner else -1
    for first, way in joints.items():
        for second, other in joints.items():
            a, b = of[first], of[second]
            of_one_tree = -1 not in (a, b) and a != b and trees[a] == trees[b]
            if first < second and of_one_tree and len(way ^ other) <= NEIGHBOURS:
                spec.add_exclude(bodyname1=first, bodyname2=second)


def _add_wall(spec: mujoco.MjSpec, wall: WallSection) -> mujoco.MjsGeom:
    normal = np.array(wall.normal) / np.linalg.norm(wall.normal)
    quat = np.zeros(4)
    mujoco.mju_quatZ2Vec(quat, normal)
    body = spec.worldbody.add_body(name="wall", pos=wall.xyz, quat=quat, gravcomp=1)
    body.mass, body.inertia, body.explicitinertial = wall.mass, [wall.mass] * 3, True
    slide = body.add_joint(name=WALL_SLIDE, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0.0, 0.0, 1.0))
    slide.stiffness[0], slide.damping[0] = wall.stiffness, wall.damping
    plate = _add_fixed_box(body, WALL, (wall.half_size, wall.half_size, _PLATE_HALF_THICKNESS))
    plate.pos[2] = -_PLATE_HALF_THICKNESS
    return plate


def _add_fixed_box(
    body: mujoco.MjsBody, name: str, half_size: tuple[float, float, float]
) -> mujoco.MjsGeom:
    return fixed(body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=half_size))


def _of_joint(values: tuple[float, ...], joint: int, n: int) -> float:
    if len(values) not in (1, n):
        raise ValueError(f"[rig.drive]: {len(values)} values for {n} joints; give one or {n}")
    return values[joint] if len(values) == n else values[0]
