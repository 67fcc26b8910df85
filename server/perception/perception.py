"""Everything that keeps an eye on something: sensor, cameras, obstacles, moving frames, contact."""

from ...config.load import Cell
from ..commands.commands import Commands
from ..control.state import Memory, Output
from ..control.tick import Control
from ..mode import Mode
from ..plant import PlantReading
from ..runtime.events import Events
from .cameras import VisionTracker
from .collisions import CollisionMonitor
from .force_torque import ForceTorqueMonitor
from .moving_frames import FrameTracker
from .obstacle_map import ObstacleMap
from .unexplained_load import LoadMonitor


class Perception:
    """The watches of one cell."""

    def __init__(self, cell: Cell, control: Control, commands: Commands, events: Events) -> None:
        sensor = cell.config.mechanism.force_torque
        essential = sensor is not None and sensor.essential
        self._control, self._commands = control, commands
        self.sensor = ForceTorqueMonitor(events, essential, cell.config.timing.period_s)
        self.load = LoadMonitor(cell, commands.settings, events)
        self.vision = VisionTracker(cell, events)
        self.obstacles = ObstacleMap(cell, events)
        self.moving_frames = FrameTracker(cell, events)
        self.collisions = CollisionMonitor(cell, control.p, control.mechanism, events)
        commands.frames.lens = lambda: self.vision.lens

    def update(
        self,
        reading: PlantReading,
        memory: Memory | None,
        output: Output | None,
        mode: Mode,
        now_s: float,
    ) -> None:
        """Take in what the devices said, and what the last tick made of it."""
        commands = self._commands
        if reading.wrench_age_s is not None:
            weight, twists = None, {}
            if output is not None:
                twists = output.twists
                weight = self._control.weight(
                    output.T_world_mrf_measured, commands.control_settings()
                )
            self.sensor.update(reading, weight, twists)
            self.load.update(output, mode, now_s, self.sensor.unloaded, self.collisions.carried)
        moved = commands.frames.moved
        self.collisions.update(reading, memory, output, moved, mode, self.load.doubt)

    def remember(self, tick: int, output: Output) -> None:
        """Keep where the arm was in a tick, for pictures that were taken in it."""
        if self.vision.watching:
            frames = self._commands.frames
            T_world_wrist = output.T_world_mrf_measured @ frames.T_wrist_mrf.inverse()
            self.vision.remember(tick, T_world_wrist, frames.moved.T_world_base_measured)

    def reason_to_stop(self) -> str | None:
        """Return why the arm may not move for what is seen, or None."""
        if self.sensor.missed:
            return "sensor stale"
        if self._commands.settings.avoid and self.obstacles.stop is not None:
            return "obstacle stale"
        return "touched" if self.collisions.stopping or self.load.touched else None
