"""Warm-up: ticks and messages with dummy inputs, so that the first real ones are not slow."""

from dataclasses import replace

import numpy as np

from ..config.load import Cell
from ..config.schema.null_space.redundancy import OBJECTIVES
from ..protocols import topics as t
from ..protocols.codec import decode_as, encode
from ..protocols.messages.messages import JoystickTwist
from .commands.commands import Commands
from .control.mechanism.null_space.redundancy import ObjectiveGains
from .control.state import Inputs, Intent
from .control.task.asked import StickCommand, ViewGoal
from .control.task.paths.goals import PathGoal, Pursuit, Segment, TwistRoute
from .control.tick import Control
from .telemetry import describe

TICKS = 20
"""Ticks of each intent that are computed [1]."""


def warm_up(cell: Cell, control: Control) -> None:
    """Run the tick with every kind of input, so that all of its code is loaded; keep nothing."""
    q = np.array(cell.config.mechanism.postures["start"])
    commands = Commands.from_cell(cell)
    settings = commands.control_settings()
    every = ObjectiveGains(dict.fromkeys(OBJECTIVES, 0.1), q)
    settings = replace(settings, objectives=every)
    moved = commands.frames.moved if cell.config.frames.moving else None
    stick = StickCommand(np.full(6, 0.01), np.eye(3))
    for intent in Intent:
        (memory,) = control.seed(q)
        for i in range(TICKS):
            T = control.arms[0].pose_mrf(memory, settings.T_wrist_mrf)
            goals = (PathGoal(T, 1), Pursuit(T, 2), TwistRoute((Segment(np.zeros(6), 1.0),), 3))
            goal = goals[i * len(goals) // TICKS]
            view = ViewGoal(settings.T_wrist_mrf, T)
            inputs = Inputs(
                0.0, intent, q, settings, stick=stick, goal=goal, view=view, moved=moved
            )
            (memory,), _ = control.tick((memory,), (inputs,))
    decode_as(t.DESCRIPTION.message, encode(describe(cell)), t.DESCRIPTION.max_bytes)
    command = JoystickTwist(seen_tick=0, twist=(0.0,) * 6)
    decode_as(t.JOYSTICK.message, encode(command), t.JOYSTICK.max_bytes)
