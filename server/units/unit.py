"""One arm of the cell and its task: what is commanded, perceived and computed for it."""

import numpy as np

from ...config.load import Cell
from ..commands.commands import Commands
from ..commands.settings import CellSettings
from ..control.arm.arm import Arm
from ..control.mechanism.joint_motion import NOTHING
from ..control.spatial import Array, Pose
from ..control.state import Inputs, Memory, Output
from ..mode import Mode
from ..perception.cameras import VisionTracker
from ..perception.contact.jam import JamMonitor
from ..perception.obstacle_map import ObstacleMap
from ..perception.perception import Perception
from ..perception.sight_lines import EVERY
from ..plant import UnitReading
from ..runtime.events import Events
from .looking_ahead import LookingAhead
from .tick_inputs import tick_inputs

LED = 1e-3
"""A hand that asks for more than this leads the tool [m/s, rad/s]."""


class Unit:
    """Commands, perception and memory of one arm; `joints`: where its own are among the cell's."""

    def __init__(
        self, cell: Cell, arm: Arm, joints: slice, settings: CellSettings, events: Events
    ) -> None:
        """Build it for one part of a cell; `settings` are those that all units share."""
        self.cell, self.arm, self.joints = cell, arm, joints
        self.events = events.of(cell.prefix.removesuffix("."))
        self.task, self.mechanism = cell.task, cell.config.mechanism.name
        self.commands = Commands.from_cell(cell, settings)
        self.ahead = LookingAhead.from_cell(cell)
        """The reflex to what is ahead, and the scanner's axis; None without either."""
        self.perception = Perception(cell, arm, self.commands, self.events)
        self.jam = JamMonitor(cell.config.timing.period_s, self.events)
        """Whether contact holds up what is asked of the tool."""
        self.memory: Memory | None = None
        """None before the arm's joints were heard, and after its devices were configured anew."""
        self.q: Array | None = None
        """Where the joints (n,) were measured last [rad]."""
        self.output: Output | None = None
        """Output of the last tick; None before the first."""

    @property
    def vision(self) -> VisionTracker:
        """The views of its cameras, as far as known."""
        return self.perception.vision

    def look_through(self, _camera: str | None) -> VisionTracker:
        """Return what knows of the view of a camera; it refuses one that the arm does not have."""
        return self.vision

    @property
    def T_world_mrf(self) -> Pose | None:
        """Where the command has the MRF in force; None before the joints were heard."""
        return None if self.output is None else mrf_in_force(self.output, self.commands)

    def holding(self, q: Array) -> Array:
        """Return the torques (n,) that hold the arm at rest at q (n,) [N·m]."""
        payload, moved = self.commands.settings.payload, self.commands.frames.moved
        return self.arm.stages.holding(q, payload, moved.T_world_base_measured.R)

    def perceive(self, reading: UnitReading, mode: Mode, now_s: float) -> None:
        """Update all monitors."""
        self.q = reading.q if reading.q is not None else self.q
        self.perception.update(reading, self.memory, self.output, mode, now_s)

    def look_around(self, obstacles: ObstacleMap, tick: int) -> None:
        """Update what depends on where obstacles are."""
        lines = self.perception.sight_lines
        if self.q is None or tick % EVERY or not (obstacles.lines or lines.lost):
            return
        moving, moved = self.perception.moving_frames.watching, self.commands.frames.moved
        lines.update(obstacles.scene(tick), self.q, moved.T_world_base_measured if moving else None)

    def follow_frames(self, tick: int, mode: Mode) -> None:
        """Bring the frames that may move up to this tick."""
        moving = mode in (Mode.ENABLED, Mode.STOPPING)
        self.commands.frames.moved = self.perception.moving_frames.step(
            tick, moving=moving, memory=self.memory, q=self.q
        )

    def inputs(
        self,
        memory: Memory,
        mode: Mode,
        tick: int,
        now_s: float,
        reading: UnitReading,
        q: Array,
        obstacles: ObstacleMap,
    ) -> Inputs:
        """Return what this tick may look at; `q` (n,) are the measured joints [rad]."""
        commands, perception = self.commands, self.perception
        moved = commands.frames.moved
        T_world_mrf = self.arm.pose_mrf(
            memory,
            commands.frames.T_wrist_mrf,
            moved.base.T if perception.moving_frames.watching else None,
        )
        asked = commands.in_force(now_s, T_world_mrf)
        if asked.posture is not None and self.cell.config.mechanism.base is not None:
            # A posture is the arm's: wheels stay where they are.
            wheels = memory.motion.q[:2]
            asked = asked._replace(posture=np.concatenate((wheels, asked.posture[2:])))
        beside = NOTHING
        if self.ahead is not None and mode is Mode.ENABLED:
            q_command, limits = memory.motion.q, () if self.output is None else self.output.limits
            rolling = self.arm.mechanism.rolling
            asked, beside = self.ahead.applied(
                asked,
                perception.passage,
                q_command,
                tick,
                0.0 if rolling is None else rolling.driven(q_command[:2])[0],
                cleared=any(name.startswith("clearance") for name in limits),
            )
        return tick_inputs(
            mode, tick, now_s, reading, q, asked, perception, obstacles, moved, beside
        )

    @property
    def blind(self) -> bool:
        """True while the base goes ahead, and nobody looks there."""
        rolling, passage = self.arm.mechanism.rolling, self.perception.passage
        if rolling is None or passage is None or self.memory is None:
            return False
        return passage.blind(rolling.driven(self.memory.motion.dq[:2])[0])

    def keep(self, tick: int, memory: Memory, output: Output) -> None:
        """Take in what a tick decided."""
        self._tell_station(memory, output)
        self.memory, self.output = memory, output
        goals = self.commands.goals
        self.commands.reflect(output)
        self.perception.remember(tick, output)
        # A payload's jam is told by its own task.
        self.jam.update(output if output.held is None else None)
        if output.at_goal and goals.posture is not None:
            goals.finish_posture()
            self.events.info("posture_reached")
        elif goals.at_rest and np.abs(output.twists["following"]).max() > LED:
            goals.led_by_hand()

    def _tell_station(self, memory: Memory, output: Output) -> None:
        """Tell when an arm that stands makes way for something that comes, and is back."""
        before = None if self.memory is None else self.memory.station
        if before is None and memory.station is not None:
            gaps = [gap for gap in output.gaps if gap.active]
            detail = f"{gaps[0].link} for {gaps[0].other}" if gaps else ""
            self.events.info("made_way", detail)
        elif before is not None and memory.station is None and output.at_rest:
            self.events.info("came_back")

    @property
    def outputs(self) -> dict[str, bool]:
        """Commanded states of the outputs, by the names of their devices."""
        told = self.commands.settings.outputs
        return {f"{self.cell.prefix}{name}": on for name, on in told.items()}


def mrf_in_force(output: Output, commands: Commands) -> Pose:
    """Return where the command has the MRF in force, in World.

    The tick that made the output may have had another one.
    """
    then, now, T = output.T_wrist_mrf, commands.frames.T_wrist_mrf, output.T_world_mrf
    return T if then is now else T @ (then.inverse() @ now)
