"""The stages of one arm's tick, each built from the sections and arrays that it needs."""

import numpy as np

from ....config.schema.mechanism.base import DifferentialBaseSection
from ..actuation.actuation import Actuation, BySpeed, ByTorque, OnWheels, by_position
from ..actuation.holding import HoldingTorque
from ..actuation.torque import TorqueLaw
from ..barriers.joint_limits import JointRoom
from ..hold.retreat import Retreat
from ..hold.standing import Standing
from ..mechanism.backbone.insertion import Backbone
from ..mechanism.contact_wrench import ContactWrench
from ..mechanism.dynamics import Dynamics
from ..mechanism.joint_motion import JointMotion
from ..mechanism.joint_rates import Resolver
from ..mechanism.kinematics import Mechanism
from ..mechanism.null_space.potential_field import Field
from ..mechanism.null_space.redundancy import Redundancy
from ..mechanism.wheels.rates import BaseRates
from ..mechanism.wrist import Wrist
from ..parameters import Parameters
from ..rigid_body import wrench_to
from ..spatial import Array, Pose
from ..task.task import Task
from .slither import Slither


class Stages:
    """Stages of one arm in a tick. Holds constants and scratch memory only."""

    def __init__(
        self,
        p: Parameters,
        mechanism: Mechanism,
        backbone: Backbone | None = None,
        base: DifferentialBaseSection | None = None,
    ) -> None:
        T, joints = p.period_s, p.joints
        self.task = Task(p.sources, p.schedules, p.shaping)
        contact = ContactWrench(
            p.T_wrist_sensor or Pose.identity(),
            p.wrench_smoothing,
            T,
            p.wrench_calibration,
            p.wrench_inertia,
            p.limits.acceleration,
        )
        self.wrist = Wrist(contact, p.payload, T)
        self.redundancy = Redundancy(joints, mechanism, p.redundancy, p.pull_posture)
        field = Field(joints, p.potential, p.capsules, mechanism.rank)
        self.resolver = Resolver(
            joints, p.resolve, mechanism.rank, self.redundancy, field, p.priority
        )
        self.slither = None
        if backbone is not None:
            self.slither = Slither(
                backbone, self.resolver, self.redundancy, mechanism.rank, joints.names
            )
        self.rolling = None
        if base is not None and mechanism.rolling is not None:
            self.rolling = BaseRates(
                base, mechanism.rolling, joints, p.resolve, (mechanism.arm_rank, mechanism.rank),
                self.redundancy, field, p.priority,
            )  # fmt: skip
        room = JointRoom.of(joints, T)
        self.joint_motion = JointMotion(joints.velocity, room.approach)
        self.retreat = None
        if p.retreat_leash is not None:
            self.retreat = Retreat(
                p.retreat_leash, T, bound=backbone is not None, gives_way=p.gives_way
            )
        self.standing = Standing(p.avoidance, p.capsules, joints.velocity)
        self.actuate = actuation(p, mechanism)
        self.holding = HoldingTorque(
            Dynamics(mechanism, p.rotor_inertia, p.T_wrist_sensor),
            None if p.T_wrist_sensor is None else p.payload,
        )


def actuation(p: Parameters, mechanism: Mechanism) -> Actuation:
    """Return the actuation of a cell's operation mode."""
    if p.operation_mode == "csv":
        return BySpeed(p.joints, p.torque.speed_gain)
    if p.operation_mode != "cst":
        if mechanism.rolling is not None:
            return OnWheels(BySpeed(p.joints, p.torque.speed_gain))
        return by_position
    law = TorqueLaw(
        Dynamics(mechanism, p.rotor_inertia, p.T_wrist_sensor),
        p.torque,
        p.friction,
        p.max_torque,
        p.resolve.characteristic_length,
        p.period_s,
        p.max_torque_rate,
        p.T_wrist_tool,
        p.rated_payload,
    )
    return ByTorque(
        p.joints.names,
        law,
        wrench_of_bias=_wrench_of_bias(p),
        most=p.max_torque,
        most_step=p.max_torque_rate * p.period_s,
    )


def _wrench_of_bias(p: Parameters) -> Array | None:
    """Return what makes a wrench at and in the Wrist of a sensor's bias (6, 6), or None."""
    T = p.T_wrist_sensor
    if T is None:
        return None
    return np.stack([wrench_to(T, column) for column in p.wrench_calibration.T], axis=1)
