"""What a tick does when MRF, CRF or ground are others than a tick ago: the same motion goes on.

Whatever a source remembers is the motion of one rigid body, and is carried to the new MRF as such:
the shaped twist of the stick, the reference that a hand leads, that of a master. The position
source leads to its goal the point of the tool that the goal was ordered for; vision and debts are
shaped where the MRF was at start. So no MRF of now is theirs. What is left are rates that depend on
the frames of now alone: accommodation about the MRF and along its axes, K_P along those of the CRF,
the ground's own motion. By how much those jump is found by asking for them twice.
"""

import numpy as np

from .evolve import evolve
from .mechanism.kinematics import Kinematics
from .rigid_body import motion_at, slowed_at, twist_at
from .spatial import Array, Pose, moved_near, rotate_twist
from .state import Inputs, Intent, Memory
from .stop.trajectory import Motion
from .task.paths.free import Free
from .task.sources.following import SLACK
from .task.sources.position import Position, PositionState


def differ(a: Pose, b: Pose) -> bool:
    """Return whether two poses are not the same to the last bit."""
    return a is not b and not (np.array_equal(a.p, b.p) and np.array_equal(a.R, b.R))


def goal_point(inputs: Inputs) -> Pose:
    """Return the point of the tool that is led to the goal, in the Wrist."""
    mrf = inputs.settings.T_wrist_mrf
    return mrf if inputs.T_wrist_goal is None else inputs.T_wrist_goal


def carried(
    memory: Memory,
    inputs: Inputs,
    k: Kinematics,
    most: tuple[float, float],
    acceleration: Array,
) -> Memory:
    """Return the memory with all that it has of the tool's motion told at the MRF of now.

    `most` [m/s], [rad/s] and `acceleration` (6,) bound what a far MRF may make of it.
    """
    before = memory.about
    if before is None:
        return memory
    mrf, point = inputs.settings.T_wrist_mrf, goal_point(inputs)
    if differ(mrf, before.T_wrist_mrf):
        lever = k.T_world_wrist.R @ (mrf.p - before.T_wrist_mrf.p)
        hand, T = memory.following, memory.following.T_world_reference
        if T is not None:
            T = T @ (before.T_wrist_mrf.inverse() @ mrf)
            T = moved_near(T, np.zeros(6), k.T_world_mrf, SLACK)
        memory = evolve(
            memory,
            joystick=evolve(
                memory.joystick,
                motion=motion_at(memory.joystick.motion, lever, most, acceleration),
            ),
            following=evolve(hand, T_world_reference=T, twist=slowed_at(hand.twist, lever, most)),
        )
    free = memory.position.path
    if isinstance(free, Free) and differ(point, before.T_wrist_goal):
        pose = free.pose @ (before.T_wrist_goal.inverse() @ point)
        now = Motion(np.zeros(6), free.twist, free.acceleration)
        now = motion_at(now, pose.p - free.pose.p, most, acceleration)
        path = free._replace(pose=pose, twist=now.dq, acceleration=now.ddq)
        memory = evolve(memory, position=evolve(memory.position, path=path))
    return memory


def led(
    source: Position,
    memory: Memory,
    inputs: Inputs,
    k: Kinematics,
    carried: Array | None,
    axes: Array,
) -> tuple[Array, PositionState]:
    """Return the twist (6,) of the MRF that leads the goal's point of the tool to the goal.

    `carried` (6,) is the twist of the goal's ground seen from Base, at the MRF; `axes` (3, 3) are
    those of the gains in World.
    """
    settings, point = inputs.settings, goal_point(inputs)
    goal = None
    if inputs.intent is Intent.MOVE and inputs.posture is None:
        goal = inputs.goal
    ground = None if inputs.moved is None else inputs.moved.body(inputs.ground)
    T, twist, lever = k.T_world_mrf, k.J @ memory.motion.dq, None
    if carried is not None:
        twist = twist - carried
    if goal is not None and differ(point, settings.T_wrist_mrf):
        T = k.T_world_wrist @ point
        lever = T.p - k.T_world_mrf.p
        twist = twist_at(twist, lever)
    if memory.off_path is not None:
        T = Pose(T.R, T.p - memory.off_path)  # without the virtual link: the path is held there
    if ground is not None and goal is not None:
        there = ground.T.R.T
        T, axes = ground.T.inverse() @ T, there @ axes
        twist = rotate_twist(there, twist)
    rate, state = source.rate(
        memory.position,
        goal,
        T,
        twist,
        memory.gains["position"],
        axes,
        settings.speed_factor,
        inputs.paused,
    )
    rate = rate if ground is None else rotate_twist(ground.T.R, rate)
    return (rate if lever is None else twist_at(rate, -lever)), state
