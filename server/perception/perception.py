"""Everything that keeps an eye on something: sensor, cameras, obstacles, moving frames, contact."""

from ...config.load import Cell
from ..commands.commands import Orders
from ..control.state import Memory, Output
from ..control.tick import Control
from ..mode import Mode
from ..plant import PlantReading
from ..runtime.events import Events
from .cameras import VisionWatch
from .collisions import TouchWatch
from .force_torque import SensorWatch
from .moving_frames import FrameWatch
from .obstacle_map import World
from .unexplained_load import LoadWatch


class Watches:
    """The watches of one cell."""

    def __init__(self, cell: Cell, control: Control, orders: Orders, events: Events) -> None:
        sensor = cell.config.mechanism.force_torque
        essential = sensor is not None and sensor.essential
        self._control, self._orders = control, orders
        self.sensor = SensorWatch(events, essential, cell.config.timing.period_s)
        self.load = LoadWatch(cell, orders.tuning, events)
        self.vision = VisionWatch(cell, events)
        self.world = World(cell, events)
        self.frames = FrameWatch(cell, events)
        self.touch = TouchWatch(cell, control.p, control.mechanism, events)
        orders.places.lens = lambda: self.vision.lens

    def look(
        self,
        reading: PlantReading,
        memory: Memory | None,
        output: Output | None,
        has_sensor: bool,
        mode: Mode,
        now_s: float,
    ) -> None:
        """Take in what the devices said, and what the last tick made of it."""
        orders = self._orders
        if has_sensor:
            weight, twists = None, {}
            if output is not None:
                twists = output.twists
                weight = self._control.stages.summing.weight(
                    output.T_world_mrf_measured, orders.settings()
                )
            self.sensor.look(reading, weight, twists)
            self.load.look(output, mode, now_s, self.sensor.unloaded, self.touch.carried)
        moved = orders.places.moved
        self.touch.look(reading, memory, output, moved, mode, self.load.doubt)

    def remember(self, tick: int, output: Output) -> None:
        """Keep where the arm was in a tick, for pictures that were taken in it."""
        if self.vision.watching:
            places = self._orders.places
            T_world_wrist = output.T_world_mrf_measured @ places.T_wrist_mrf.inverse()
            self.vision.remember(tick, T_world_wrist, places.moved.T_world_base_measured)

    def reason_to_stop(self) -> str | None:
        """Return why the arm may not move for what is seen, or None."""
        if self.sensor.missed:
            return "sensor stale"
        if self._orders.tuning.avoid and self.world.stop is not None:
            return "obstacle stale"
        return "touched" if self.touch.stopping or self.load.touched else None
