"""One period of the daemon: SYNC; read, take commands, decide the mode, tick, write, tell.

`begin` sends SYNC k at its deadline; `finish` does the rest once the drives have answered. Every
cycle ends in a safe command: whatever is raised on the way ends in a quick stop of every drive.
"""

import time
from collections.abc import Callable

import numpy as np

from ..config.load import Cell
from ..drivers.device import Cause, Trouble
from .commands.commands import Commands
from .control.barriers.clearance import Gap
from .control.spatial import Array, Pose
from .control.state import Memory, Output
from .control.tick import Control
from .faults import FaultDetector
from .mode import Mode
from .operators.admission import Admission, Grants, Instant
from .operators.dispatcher import Dispatcher
from .operators.exposure import opening_events
from .operators.inbox import Inbox
from .operators.link import Link
from .operators.request_context import RequestContext
from .operators.services import Services
from .perception.perception import Perception
from .plant import Plant, PlantReading
from .power import DrivePower
from .runtime.clock import Clock
from .supervisor import Supervisor
from .telemetry import Telemetry, TickRecord, describe
from .tick_inputs import tick_inputs
from .warm_up import warm_up

LED = 1e-3
"""A hand that asks for more than this leads the tool [m/s, rad/s]."""


class Cycle:
    """The daemon's period over its plant, its operators' link and its control."""

    def __init__(
        self,
        cell: Cell,
        control: Control,
        plant: Plant,
        link: Link,
        clock: Clock,
        new_key: Callable[[], bytes],
        gain_bound: Callable[[str, tuple[float, ...]], str | None],
    ) -> None:
        name, timing = cell.config.name, cell.config.timing
        self.tick = 0
        self.compute_s = 0.0
        """Time that the last control computation took [s]."""
        self.output: Output | None = None
        self.cell, self.plant, self.clock = cell, plant, clock
        self._control, self._link, self._gain_bound = control, link, gain_bound
        self._heartbeat_every = max(1, int(timing.heartbeat_period_s / timing.period_s))
        self._memory: Memory | None = None
        self._last_q: Array | None = None
        self._events = events = opening_events(cell.config.zenoh)
        self._admission = admission = Admission(
            name, timing.period_s, timing.max_command_age_s, timing.lease_timeout_s
        )
        self._commands = commands = Commands.from_cell(cell)
        services = Services(admission, commands, events, Grants(name, admission, new_key))
        self._services = services
        inbox = Inbox(link, admission, clock.now, timing.period_s)
        self._dispatcher = Dispatcher(inbox, admission, services, commands, events)
        (arm,) = control.arms
        self._perception = Perception(cell, arm, commands, events)
        self._supervisor = Supervisor(
            plant,
            FaultDetector(arm.p.joints, cell.config.mechanism.drives),
            DrivePower(cell.robot.joints, plant, events, self._holding),
            services,
            admission,
            commands,
            events,
            clock.now,
            timing.tolerated_overruns,
        )
        self._telemetry = Telemetry(describe(cell), link, events)

    @property
    def mode(self) -> Mode:
        """The mode that the last tick decided."""
        return self._supervisor.mode

    def boot(self) -> None:
        """Configure every device; blocks. Raises `DeviceError`."""
        self.plant.open()

    def warm_up(self) -> None:
        """Run through a tick's code once, so that the first real one is not slow."""
        warm_up(self.cell, self._control)
        self._commands.settings.payload_bounds.prepare()

    def close(self) -> None:
        """Stop and release everything, whatever state it is in."""
        self.plant.close()
        self._link.close()

    def retire(self) -> None:
        """Stop the arm, switch it off, and let it move no more: the daemon is about to end."""
        self._supervisor.retiring = True
        self._events.warning("retiring", "the daemon was told to end")

    def wait_in_boot(self, reason: str) -> None:
        """Answer operators while a device is missing, and tell them which."""
        now_s = self.clock.now()
        self.tick += 1
        self._events.at(self.tick, now_s)
        self._events.warning("device_missing", reason)
        self._dispatcher.take(self._observe(now_s, self.plant.read(now_s)))
        self._telemetry.publish_events()

    @property
    def placed_target(self) -> tuple[str, Pose] | None:
        """Where the position source is to bring the MRF, if anywhere: a ground, a pose on it."""
        return self._commands.placed_target

    @property
    def T_wrist_mrf(self) -> Pose:
        """The MRF that is in force."""
        return self._commands.frames.T_wrist_mrf

    @property
    def pressed(self) -> bool:
        """True while so much junk comes in that it should be sorted more than once a period."""
        return self._dispatcher.pressed

    def listen(self) -> None:
        """Sort what has come in from the network, between two ticks' work."""
        self._dispatcher.listen(
            Instant(self.clock.now(), self.tick, self._supervisor.enabled_since)
        )

    def gather(self) -> None:
        """Take in what has come by now: a late answer shall not pass for one to the next SYNC."""
        self.plant.buses.receive(self.clock.now())

    def begin(self) -> None:
        """Send SYNC, and now and then the heartbeat that only a living tick produces."""
        self.tick += 1
        self.plant.buses.sync()
        if self.tick % self._heartbeat_every == 0:
            self.plant.buses.heartbeat()

    def missed(self, periods: int) -> None:
        """Count deadlines that passed unserved before this tick; 0 for a tick in time."""
        self._supervisor.missed(periods)

    def finish(self) -> None:
        """Do one period's work; quick-stop if anything is raised."""
        now_s = self.clock.now()
        self._events.at(self.tick, now_s)
        try:
            self._finish(now_s)
        except Exception as error:  # noqa: BLE001  outermost: whatever it is, the arm stops
            words = f"{type(error).__name__}: {error}"
            self._quick_stop("daemon", words, "tick_raised")
        self._telemetry.publish_events()

    def _finish(self, now_s: float) -> None:
        reading = self.plant.read(now_s)
        context = self._observe(now_s, reading)
        self._dispatcher.take(context)
        # Only now: what was just commanded was placed where arm and frames were together, a tick
        # ago.
        moving = self.mode in (Mode.ENABLED, Mode.STOPPING)
        self._commands.frames.moved = self._perception.moving_frames.step(self.tick, moving=moving)
        reason = reading.interlock or self._perception.reason_to_stop()
        if self._supervisor.update(reading, self.output, context, reason):
            self._memory = None
        if reading.q is not None:
            self._last_q = reading.q
            self._compute_and_write(now_s, reading, reading.q)
        if self._last_q is not None and self.output is not None:
            # With a drive missing, operators still hear: where the joints were, and what is wrong.
            record = TickRecord(
                self.tick,
                now_s,
                self.mode,
                reading,
                self._last_q,
                self.output,
                self._services.protective_stop is not None,
                self._supervisor.overruns,
            )
            self._telemetry.publish(record, self._commands, self._perception, self._admission)

    def _holding(self, q: Array) -> Array:
        """Return the torques (n,) that hold the arm at rest at q (n,) [N·m]."""
        payload, moved = self._commands.settings.payload, self._commands.frames.moved
        return self._control.arms[0].stages.holding(q, payload, moved.T_world_base_measured.R)

    def _quick_stop(self, device: str, words: str, event: str) -> None:
        self._supervisor.quick_stop(Trouble(Cause.STATE_LOST, device, words), event)

    def _observe(self, now_s: float, reading: PlantReading) -> RequestContext:
        """Update all monitors, and return what a request may depend on."""
        perception, output = self._perception, self.output
        perception.update(reading, self._memory, output, self.mode, now_s)
        return RequestContext(
            now=Instant(now_s, self.tick, self._supervisor.enabled_since),
            mode=self.mode,
            unloaded=perception.sensor.unloaded,
            still=perception.sensor.still,
            essential_stale=perception.sensor.missed,
            gain_bound=self._gain_bound,
            vision=perception.vision,
            obstacles=perception.obstacles,
            moving_frames=perception.moving_frames,
            T_world_mrf=None if output is None else output.T_world_mrf,
            T_wrist_mrf=None if output is None else output.T_wrist_mrf,
            touched=perception.touched,
            drives_off=reading.off,
        )

    def _compute_and_write(self, now_s: float, reading: PlantReading, q: Array) -> None:
        if self._memory is None:
            (self._memory,) = self._control.seed(q)
        commands, perception, moved = self._commands, self._perception, self._commands.frames.moved
        T_world_mrf = self._control.arms[0].pose_mrf(
            self._memory,
            commands.frames.T_wrist_mrf,
            moved.base.T if perception.moving_frames.watching else None,
        )
        asked = commands.in_force(now_s, T_world_mrf)
        inputs = tick_inputs(self.mode, self.tick, now_s, reading, q, asked, perception, moved)
        start = time.perf_counter()
        (self._memory,), (output,) = self._control.tick((self._memory,), (inputs,))
        self.compute_s = time.perf_counter() - start
        self.output = output
        if output.stop_worsened:
            self._tell_worsened(output.gaps)
        if output.refusal is not None and self.mode is not Mode.FAULT:
            self._quick_stop("gate", output.refusal, "gate_refused")
        self.plant.write(output.command)
        self.plant.switch(commands.settings.outputs)
        commands.reflect(output)
        perception.remember(self.tick, output)
        if output.at_goal and commands.goals.posture is not None:
            commands.goals.finish_posture()
            self._events.info("posture_reached")
        elif commands.goals.at_rest and np.abs(output.twists["following"]).max() > LED:
            commands.goals.led_by_hand()

    def _tell_worsened(self, gaps: tuple[Gap, ...]) -> None:
        """Tell that an obstacle came too near for any stop, and which is nearest."""
        nearest = gaps[0] if gaps else None
        self._events.warning(
            "stop_worsened",
            "no stop keeps every clearance any more: the least bad one is taken",
            link=None if nearest is None else nearest.link,
            obstacle=None if nearest is None else nearest.other,
            gap_m=None if nearest is None else nearest.gap,
        )
