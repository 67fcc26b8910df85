"""Perception of one arm: the monitors of sensor, load, cameras, moving frames and collisions."""

from dataclasses import replace

from ...config.load import Cell
from ...protocols.messages.perception import ContourNews
from ..commands.commands import Commands
from ..control.arm import Arm
from ..control.bodies.rates import ArmTick
from ..control.inputs import Payload
from ..control.spatial import Pose, rotate_twist
from ..control.state import ArmMemory
from ..events import Events
from ..mode import Mode
from ..plant import UnitReading
from ..refusals import Refused, Why
from .ahead import Passage
from .cameras import SightLines, VisionTracker
from .collisions import CollisionMonitor, WallMonitor
from .contact import ContactStability, PressedTool
from .moving_frames import FrameTracker
from .wrench import ForceTorqueMonitor, LoadMonitor, UnchangingForce, reads_weight


class Perception:
    """All monitors of one arm of a cell."""

    def __init__(self, cell: Cell, arm: Arm, commands: Commands, events: Events) -> None:
        config, period_s = cell.config, cell.config.timing.period_s
        sensor, damping = config.mechanism.force_torque, config.sources.following.damping
        essential = sensor is not None and sensor.essential
        self._arm, self._commands = arm, commands
        self._T_world_mrf: Pose | None = None
        self.sensor = ForceTorqueMonitor(events, essential, period_s, arm.wrist.weight)
        self.load = LoadMonitor(sensor, self.sensor, damping, period_s, commands.settings, events)
        self.vision = VisionTracker.from_cell(cell, events)
        self.moving_frames = FrameTracker.from_cell(cell, events)
        self.sight_lines = SightLines(arm.p.capsules, events)
        self.passage = Passage.from_cell(cell, events)
        """The contour ahead; None where nobody looks for one."""
        self.collisions = CollisionMonitor(
            config.touch, arm.p, arm.mechanism, events, arm.body.on_curve
        )
        self.pressed = PressedTool(config.sources.force.hold_threshold, period_s)
        """Contact of the tool while its joints are commanded themselves."""
        self._walls = WallMonitor(arm, period_s, events)
        self.ringing = ContactStability(
            commands.settings.bounds.force_loop,
            commands,
            config.sources.force.hold_threshold,
            period_s,
            events,
        )
        self.hand = UnchangingForce(config.sources.following, commands.settings, period_s, events)
        self.touched = False
        """Something pushes the arm that it stopped for."""
        commands.frames.lens = self.vision.lens
        commands.frames.moved = self.moving_frames.moved

    def update(
        self,
        reading: UnitReading,
        memory: ArmMemory | None,
        output: ArmTick | None,
        mode: Mode,
        now_s: float,
    ) -> None:
        """Update all monitors; `memory` and `output` are those of the tick before."""
        commands, settings, wrench = self._commands, self._commands.settings, None
        if output is not None and output.wrench is not None:
            wrench = rotate_twist(output.T_world_mrf_measured.R, output.wrench)
        self._walls.update(memory, reading.q)
        if self.moving_frames.base is not None:
            self.moving_frames.base.take_inertial(reading.inertial)
        if reading.wrench_age_s is not None:
            if output is not None:
                self._T_world_mrf = output.T_world_mrf_measured
            self.sensor.update(reading, output, settings.payload, settings.wrench_bias)
            if output is None or output.holding is None:
                self.load.update(output, wrench, mode, now_s, self.collisions.carried)
                settings.contact_share = self.ringing.update(output, mode)
                settings.untold = self.hand.update(output, wrench, mode, self.load.trust)
            else:
                settings.untold = None
        doubted = self.load.tool
        by_joint = doubted is None and commands.by_joint(now_s)
        self.pressed.follow(output, by_joint, mode)
        tool = self.pressed if doubted is None and self.pressed.watching else doubted
        moved = commands.frames.moved
        doubt = self.load.doubt
        self.collisions.update(reading, memory, output, wrench, moved, mode, doubt, tool)
        stopping = self.collisions.release.touched and not self.collisions.release.withdraws
        self.touched = stopping or self.load.touched or self.pressed.touched

    def look_ahead(self, news: ContourNews, tick: int) -> None:
        """Take in a contour, and what scans say of slip. Raises `Refused` where it does not fit."""
        if self.passage is None:
            raise Refused(Why.NOT_NOW, "the cell says nothing of a contour")
        self.passage.take(news, tick)
        if self.moving_frames.base is not None:
            self.moving_frames.base.take_slide(news.tick, news.slipping, news.slide)

    def weighed(self, payload: Payload) -> bool:
        """Return whether the sensor reads the weight of a payload: so it hangs there."""
        unloaded, at = self.sensor.unloaded, self._T_world_mrf
        if unloaded is None or at is None:
            return False
        told = self._commands.settings.for_control()
        changed = self._arm.weight(at, told) - self._arm.weight(at, replace(told, payload=payload))
        return reads_weight(unloaded + changed - told.wrench_bias, payload)

    def remember(self, tick: int, output: ArmTick) -> None:
        """Store the pose of the arm in a tick, for pictures that were exposed in it."""
        frames = self._commands.frames
        T_world_wrist = output.T_world_mrf_measured @ output.T_wrist_mrf.inverse()
        self.vision.remember(tick, T_world_wrist, frames.moved.T_world_base_measured)
