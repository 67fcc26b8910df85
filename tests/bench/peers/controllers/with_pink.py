"""Pink: differential inverse kinematics with control barrier functions, on Pinocchio and Coal.

Set up as its own example of collision avoidance for whole arms is (examples/barriers, two KUKA
arms): its costs, barrier gain and safe displacement; the closest pairs in the barrier; solver
DAQP. A thing that moves is placed anew every tick; the barrier knows no speed of things.
"""

import numpy as np
import pink
import pinocchio as pin
from pink.barriers import SelfCollisionBarrier
from pink.exceptions import NoSolutionFound
from pink.limits import AccelerationLimit, ConfigurationLimit, VelocityLimit
from pink.tasks import FrameTask, PostureTask
from telerobot.config.load import Cell
from telerobot.server.control.spatial import Array, Pose

from ..geometry import PeerGeometry
from ..scenes import PeerScene
from .contract import CLEARANCE, NoCommand

POSITION_COST = 50.0
ORIENTATION_COST = 10.0
POSTURE_COST = 1e-3
BARRIER_GAIN = 20.0
SAFE_DISPLACEMENT_GAIN = 1.0
CLOSEST_PAIRS = 24
"""Only so many of all pairs, the closest ones, are in the programme: the others cost time."""


class Pink:
    """Frame task, posture task, limits of position and speed, barrier over all pairs."""

    accelerates = False
    """True where its acceleration limit is on."""

    def __init__(self, cell: Cell, scene: PeerScene) -> None:
        drives = {drive.joint: drive for drive in cell.config.mechanism.drives}
        ordered = [drives[joint.name] for joint in cell.robot.joints]
        self._period_s = cell.config.timing.period_s
        self._geometry = PeerGeometry(cell, scene.things)
        self._moving = scene.moves
        model = self._geometry.model
        mrf = cell.config.mechanism.T_wrist_mrf
        T = Pose.from_xyz_rpy(mrf.xyz, mrf.rpy)
        tip = model.frames[model.getFrameId(cell.config.mechanism.tip_link)]
        placement = tip.placement * pin.SE3(T.R, T.p)
        model.addFrame(pin.Frame("mrf", tip.parentJoint, placement, pin.FrameType.OP_FRAME))
        margin = np.array([drive.position_margin for drive in ordered])
        model.lowerPositionLimit += margin
        model.upperPositionLimit -= margin
        model.velocityLimit = np.array([drive.max_velocity for drive in ordered])
        self._limits = [ConfigurationLimit(model), VelocityLimit(model)]
        self._acceleration = AccelerationLimit(
            model, np.array([drive.max_acceleration for drive in ordered])
        )
        if self.accelerates:
            self._limits.append(self._acceleration)
        data = pin.GeometryData(self._geometry.shapes)
        data.enable_contact = True
        self._configuration = pink.Configuration(
            model,
            model.createData(),
            np.array(scene.start),
            collision_model=self._geometry.shapes,
            collision_data=data,
        )
        self._tool = FrameTask("mrf", POSITION_COST, ORIENTATION_COST)
        posture = PostureTask(POSTURE_COST)
        posture.set_target_from_configuration(self._configuration)
        self._tasks = [self._tool, posture]
        self._T_base_world = pin.SE3(self._geometry.T_base_world.R, self._geometry.T_base_world.p)

    def aim(self, target: Pose) -> None:
        """Nothing to do: the reference leads to the target."""

    def step(self, q: Array, tick: int, reference: Pose) -> Array:
        """Return where the solved joint rates lead in a period."""
        if self._moving:
            self._geometry.move(tick * self._period_s)
        self._configuration.update(q)
        self._tool.set_target(self._T_base_world * pin.SE3(reference.R, reference.p))
        pairs = min(CLOSEST_PAIRS, len(self._geometry.shapes.collisionPairs))
        # A new one every tick: it would take an arm that stands for a scene that stands.
        barrier = SelfCollisionBarrier(
            pairs, BARRIER_GAIN, safe_displacement_gain=SAFE_DISPLACEMENT_GAIN, d_min=CLEARANCE
        )
        try:
            dq = pink.solve_ik(
                self._configuration,
                self._tasks,
                self._period_s,
                solver="daqp",
                limits=self._limits,
                barriers=[barrier],
                safety_break=False,
            )
        except NoSolutionFound as error:
            self._acceleration.set_last_integration(np.zeros(len(q)), self._period_s)
            raise NoCommand("no solution") from error
        self._acceleration.set_last_integration(dq, self._period_s)
        return np.asarray(q + dq * self._period_s)

    @classmethod
    def settings(cls) -> dict[str, object]:
        """Return how it is set up."""
        return {
            "position_cost": POSITION_COST,
            "orientation_cost": ORIENTATION_COST,
            "posture_cost": POSTURE_COST,
            "barrier_gain": BARRIER_GAIN,
            "safe_displacement_gain": SAFE_DISPLACEMENT_GAIN,
            "d_min": CLEARANCE,
            "closest_pairs": CLOSEST_PAIRS,
            "acceleration_limit": cls.accelerates,
            "solver": "daqp",
        }


class PinkAccelerating(Pink):
    """The same with its limit of joint acceleration."""

    accelerates = True
