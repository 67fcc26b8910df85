"""Assembly of the tick's inputs from reading, commands and perception."""

import numpy as np

from ...protocols.canopen.cia402 import DriveState
from ..commands.in_force import InForce
from ..control.frame_tree import Moved
from ..control.mechanism.backbone.insertion import STILL
from ..control.mechanism.joint_motion import NOTHING, Beside
from ..control.spatial import Array
from ..control.state import Inputs, Intent
from ..mode import Mode
from ..perception.obstacle_map import ObstacleMap
from ..perception.perception import Perception
from ..plant import UnitReading

INTENTS = {
    Mode.BOOT: Intent.SEED,
    Mode.READY: Intent.SEED,
    Mode.ENABLED: Intent.MOVE,
    Mode.STOPPING: Intent.STOP,
    Mode.HOLD: Intent.HOLD,
    Mode.FAULT: Intent.SEED,
}
"""The tick's permission in each mode."""


def tick_inputs(
    mode: Mode,
    tick: int,
    time_s: float,
    reading: UnitReading,
    q: Array,
    commands: InForce,
    perception: Perception,
    obstacles: ObstacleMap,
    moved: Moved,
    beside: Beside = NOTHING,
) -> Inputs:
    """Return the inputs of a tick; `q` (n,) are the measured joints [rad], `moved` the grounds.

    Sources and goals act in ENABLED only; in the other modes the arm may give way to contact.
    """
    intent = INTENTS[mode]
    moving = intent is Intent.MOVE
    drive = commands.drive if moving else STILL
    # Once touched, an arm in tunnels may withdraw as a curve, and do nothing else.
    bent = moving and not perception.collisions.withdraws
    if perception.collisions.withdraws:
        drive = drive._replace(back_only=True)
    grounds_move = perception.moving_frames.watching
    return Inputs(
        time_s=time_s,
        intent=intent,
        q_measured=q,
        settings=commands.settings,
        energised=np.array([s is DriveState.OPERATION_ENABLED for s in reading.states]),
        wrench_sensor=reading.wrench,
        wrench_age_s=reading.wrench_lag_s,
        wrench_mean=reading.wrench_over_period,
        stick=commands.stick if moving else None,
        jog=commands.jog if bent else None,
        goal=commands.goal if moving else None,
        paused=commands.paused,
        view=perception.vision.goal(moved.base.T) if moving else None,
        posture=commands.posture if bent else None,
        at_posture=commands.at_posture,
        wrench_desired=commands.wrench_desired,
        scene=obstacles.scene(tick) if obstacles.known else None,
        R_world_wrench=commands.R_world_wrench,
        moved=moved if grounds_move else None,
        ground=commands.ground if grounds_move else "world",
        T_wrist_goal=commands.T_wrist_goal,
        drive=drive,
        pushed=None if moving else perception.collisions.pushed,
        beside=beside if moving else NOTHING,
    )
