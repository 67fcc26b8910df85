"""mink: differential inverse kinematics with collision avoidance limits, on MuJoCo.

Set up as its examples of arms with collision avoidance are: frame task, posture task, limits of
position, speed and collisions, damping; solver DAQP. A thing that moves is a mocap body, placed
every tick; the limit knows no speed of things.
"""

import mink
import mujoco
import numpy as np
from telerobot.config.load import Cell
from telerobot.server.control.spatial import Array, Pose

from ..geometry import PeerGeometry
from ..scenes import PeerScene, Thing
from .contract import CLEARANCE, NoCommand

POSTURE_COST = 1e-2
DAMPING = 1e-3
LM_DAMPING = 1.0
COLLISION_GAIN = 0.85
DETECTION_DISTANCE = 0.10


class Mink:
    """Frame task, posture task, limits of position, speed and collisions."""

    def __init__(self, cell: Cell, scene: PeerScene) -> None:
        mechanism = cell.config.mechanism
        drives = {drive.joint: drive for drive in mechanism.drives}
        self._period_s = cell.config.timing.period_s
        geometry = PeerGeometry(cell, scene.things)
        spec = mujoco.MjSpec.from_file(str(cell.robot.urdf))
        T = Pose.from_xyz_rpy(mechanism.T_wrist_mrf.xyz, mechanism.T_wrist_mrf.rpy)
        spec.body(mechanism.tip_link).add_site(name="mrf", pos=T.p, quat=_quaternion(T.R))
        _name_geoms(spec)
        for thing in scene.things:
            _add(spec, thing, geometry.T_base_world)
        model = spec.compile()
        for joint in cell.robot.joints:
            margin = drives[joint.name].position_margin
            model.jnt_range[model.joint(joint.name).id] += (margin, -margin)
        self._moving = tuple(
            (int(model.body(thing.name).mocapid[0]), thing) for thing in scene.things if thing.moves
        )
        self._T_base_world = geometry.T_base_world
        self._configuration = mink.Configuration(model, np.array(scene.start))
        self._tool = mink.FrameTask("mrf", "site", 1.0, 1.0, lm_damping=LM_DAMPING)
        posture = mink.PostureTask(model, cost=POSTURE_COST)
        posture.set_target_from_configuration(self._configuration)
        self._tasks = [self._tool, posture]
        every = [*geometry.names, *(t.name for t in scene.things)]
        pairs = [([every[i]], [every[k]]) for i, k in geometry.own + geometry.with_things]
        self._limits = [
            mink.ConfigurationLimit(model),
            mink.VelocityLimit(model, {name: drive.max_velocity for name, drive in drives.items()}),
            mink.CollisionAvoidanceLimit(
                model,
                pairs,
                gain=COLLISION_GAIN,
                minimum_distance_from_collisions=CLEARANCE,
                collision_detection_distance=DETECTION_DISTANCE,
            ),
        ]

    def aim(self, target: Pose) -> None:
        """Nothing to do: the reference leads to the target."""

    def step(self, q: Array, tick: int, reference: Pose) -> Array:
        """Return where the solved joint rates lead in a period."""
        T = self._T_base_world
        for mocap, thing in self._moving:
            centre = thing.at(tick * self._period_s).centre
            self._configuration.data.mocap_pos[mocap] = T.R @ centre + T.p
        self._configuration.update(q)
        aim = T @ reference
        self._tool.set_target(
            mink.SE3.from_rotation_and_translation(mink.SO3.from_matrix(aim.R), aim.p)
        )
        try:
            dq = mink.solve_ik(
                self._configuration,
                self._tasks,
                self._period_s,
                "daqp",
                damping=DAMPING,
                limits=self._limits,
            )
        except mink.NoSolutionFound as error:
            raise NoCommand("no solution") from error
        return np.asarray(q + dq * self._period_s)

    @staticmethod
    def settings() -> dict[str, object]:
        """Return how it is set up."""
        return {
            "frame_cost": 1.0,
            "lm_damping": LM_DAMPING,
            "posture_cost": POSTURE_COST,
            "damping": DAMPING,
            "collision_gain": COLLISION_GAIN,
            "minimum_distance": CLEARANCE,
            "detection_distance": DETECTION_DISTANCE,
            "solver": "daqp",
        }


def _name_geoms(spec: mujoco.MjSpec) -> None:
    """Name the arm's geoms as `PeerGeometry` does: by link and number."""
    for body in spec.bodies:
        for i, geom in enumerate(body.geoms):
            link = "base" if body.name == "world" else body.name
            geom.name = f"{link}_{i}"


def _add(spec: mujoco.MjSpec, thing: Thing, T_base_world: Pose) -> None:
    T = T_base_world @ Pose.from_xyz_rpy(thing.xyz, thing.rpy)
    body = spec.worldbody.add_body(name=thing.name, mocap=True, pos=T.p, quat=_quaternion(T.R))
    kind, size = {
        "sphere": (mujoco.mjtGeom.mjGEOM_SPHERE, (thing.radius, 0.0, 0.0)),
        "capsule": (mujoco.mjtGeom.mjGEOM_CAPSULE, (thing.radius, thing.half_length, 0.0)),
        "box": (mujoco.mjtGeom.mjGEOM_BOX, thing.half_size),
    }[thing.shape]
    body.add_geom(name=thing.name, type=kind, size=size)


def _quaternion(R: Array) -> Array:
    found = np.zeros(4)
    mujoco.mju_mat2Quat(found, R.ravel())
    return found
