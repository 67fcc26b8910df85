"""The common twist of a shared MRF: the sources of a joint task, asked as those of one arm."""

from ....config.schema.joint_task import JointTaskSection
from ..arm.arm import Arm
from ..arm.context import context_of, quantities
from ..mechanism.kinematics import Kinematics
from ..mechanism.wrist import WristMemory
from ..spatial import Array, Pose
from ..state import Inputs, Intent, Memory, Output
from ..task.source import Granted
from ..task.task import Task, TaskMemory

AT_EACH_GRASP = ("force", "following")
"""Sources that do not act at the shared MRF."""

SLID = 0.99
"""A payload that does less than this part of what its path does has been turned off it [1]."""


class Common:
    """The sources of one joint task."""

    def __init__(self, section: JointTaskSection, first: Arm, p_wrist_mrf: Array) -> None:
        """Build them; the `first` arm's Wrist has the MRF at `p_wrist_mrf` (3,) at start."""
        self._task = Task(section.sources, section.schedules, first.p.shaping)
        self._wrist, self._p_wrist_mrf = first.stages.wrist, p_wrist_mrf
        self.idle = self._task.idle

    def summed(
        self,
        memory: TaskMemory,
        first: Memory,
        told: Inputs,
        wrist: WristMemory,
        k: Kinematics,
        T_world_mrf: Pose,
    ) -> tuple[TaskMemory, dict[str, Array]]:
        """Return the task's memory and the twists (6,) of its sources, at the mean MRF.

        They are asked as those of one arm would be, whose Wrist is where the first one's would be
        if all views agreed.
        """
        mrf = told.settings.T_wrist_mrf
        there = Kinematics(T_world_mrf @ mrf.inverse(), T_world_mrf, k.J)
        moving = told.intent is Intent.MOVE
        since_s = first.moving_since_s if first.moving_since_s is not None else told.time_s
        memory = self._task.tuned(
            memory,
            told.settings.gains,
            lambda: quantities(wrist, told, there, told.time_s - since_s),
            moving,
            told.settings.at_once,
        )
        context = context_of(
            first.motion.dq, None, wrist, None, told, there,
            self._wrist, there.T_world_wrist.R @ (self._p_wrist_mrf - mrf.p), None, None,
        )  # fmt: skip
        all_gains = memory.gains
        common = {name: gain for name, gain in all_gains.items() if name not in AT_EACH_GRASP}
        memory, twists = self._task.twists(memory._replace(gains=common), context)
        return memory._replace(gains=all_gains), twists

    def advanced(
        self, memory: TaskMemory, twist: Array, T_world_mrf: Pose, first: Output, pace: float
    ) -> TaskMemory:
        """Return the memory after a tick in which the `first` arm did what its output says.

        `twist` (6,) was asked for; a path may go on at a part `pace` (0 to 1) of its own speed.
        """
        stopped = "verified_stop" in first.limits
        share = 0.0 if stopped else first.scale
        granted = Granted(
            share, 0.0 if stopped else pace, first.scale < SLID * pace, twist, T_world_mrf
        )
        return self._task.advanced(memory, granted)
