"""Warm-up: ticks and messages with dummy inputs, so that the first real ones are not slow."""

from dataclasses import replace

import numpy as np

from ..config.load import Cell
from ..config.schema.null_space.redundancy import OBJECTIVES
from ..protocols import topics as t
from ..protocols.codec import decode_as, encode
from ..protocols.messages.messages import JoystickTwist
from .commands.commands import Commands
from .control.arm.arm import Arm
from .control.mechanism.null_space.redundancy import ObjectiveGains
from .control.state import Inputs, Intent, Memory
from .control.task.asked import StickCommand, ViewGoal
from .control.task.paths.goals import PathGoal, Pursuit, TwistRoute, TwistSegment
from .control.tick import Control
from .telemetry import describe

TICKS = 20
"""Ticks of each intent that are computed [1]."""


def warm_up(cell: Cell, control: Control) -> None:
    """Run the tick with every kind of input, so that all of its code is loaded; keep nothing."""
    dummies = [_Dummy(part, arm) for part, arm in zip(cell.parts, control.arms, strict=True)]
    for intent in Intent:
        memories = control.seed(np.concatenate([dummy.q for dummy in dummies]))
        for i in range(TICKS):
            inputs = [
                dummy.inputs(memory, intent, i / TICKS)
                for dummy, memory in zip(dummies, memories, strict=True)
            ]
            memories, _ = control.tick(memories, inputs)
    decode_as(t.DESCRIPTION.message, encode(describe(cell)), t.DESCRIPTION.max_bytes)
    command = JoystickTwist(seen_tick=0, twist=(0.0,) * 6)
    decode_as(t.JOYSTICK.message, encode(command), t.JOYSTICK.max_bytes)


class _Dummy:
    """Dummy inputs of one arm."""

    def __init__(self, part: Cell, arm: Arm) -> None:
        self._arm = arm
        self.q = np.array(part.config.mechanism.postures["start"])
        commands = Commands.from_cell(part)
        every = ObjectiveGains(dict.fromkeys(OBJECTIVES, 0.1), self.q)
        self._settings = replace(commands.control_settings(), objectives=every)
        self._moved = commands.frames.moved if commands.frames.may_move else None
        self._stick = StickCommand(np.full(6, 0.01), np.eye(3))

    def inputs(self, memory: Memory, intent: Intent, way: float) -> Inputs:
        """Return the inputs of a tick; `way` from 0 to 1 goes through the kinds of goals."""
        mrf = self._settings.T_wrist_mrf
        T = self._arm.pose_mrf(memory, mrf)
        goals = (PathGoal(T, 1), Pursuit(T, 2), TwistRoute((TwistSegment(np.zeros(6), 1.0),), 3))
        return Inputs(
            0.0,
            intent,
            self.q,
            self._settings,
            stick=self._stick,
            goal=goals[int(way * len(goals))],
            view=ViewGoal(mrf, T),
            moved=self._moved,
        )
