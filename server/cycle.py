"""One period of the daemon: SYNC; read, take orders, decide the mode, tick, write, tell.

`begin` sends SYNC k at its deadline; `finish` does the rest once the drives have answered. Every
cycle ends in a safe command: whatever is raised on the way ends in a quick stop of every drive.
"""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..config.load import Cell
from ..drivers.device import Cause, DeviceError, Trouble
from ..protocols.canopen.cia402 import DriveState
from ..protocols.codec import encode
from ..protocols.topics import DESCRIPTION, EVENT, REFLECTION, STATE
from .commands.commands import Commands
from .control.barriers.clearance import Gap
from .control.spatial import Array, Pose
from .control.state import Inputs, Intent, Memory, Output
from .control.tick import Control
from .faults import FaultDetector
from .mode import Mode, ModeInputs, Wish, next_mode
from .operators.admission import Admission, Instant
from .operators.dispatcher import Dispatcher
from .operators.exposure import opening_events
from .operators.grants import Grants
from .operators.inbox import Inbox
from .operators.link import Link
from .operators.services import RequestContext, Services
from .perception.perception import Perception
from .plant import Plant, PlantReading
from .power import DrivePower
from .refusals import Refused, Why
from .runtime.clock import Clock
from .telemetry import describe, report
from .warm_up import warm_up

DESCRIBE_EVERY = 100
"""Ticks between two descriptions, for operators that come late [1]."""

LED = 1e-3
"""A hand that asks for more than this leads the tool [m/s, rad/s]."""

OVERRUNS = "overruns"
"""Why the arm stops when ticks were late: no reason to give up enabling it, which moves nothing."""

INTENTS = {
    Mode.BOOT: Intent.SEED,
    Mode.READY: Intent.SEED,
    Mode.ENABLED: Intent.MOVE,
    Mode.STOPPING: Intent.STOP,
    Mode.HOLD: Intent.HOLD,
    Mode.FAULT: Intent.SEED,
}


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
        timing = cell.config.timing
        self.mode = Mode.BOOT
        self.tick = 0
        self.overruns = 0
        self.compute_s = 0.0
        """Time that the last control computation took [s]."""
        self.output: Output | None = None
        self.cell, self.plant, self.clock = cell, plant, clock
        self._control, self._link, self._gain_bound = control, link, gain_bound
        self._faults = FaultDetector(cell, control.p)
        self._late_in_a_row = 0
        self._tolerated_overruns = timing.tolerated_overruns
        self._heartbeat_every = max(1, int(timing.heartbeat_period_s / timing.period_s))
        self._events = opening_events(cell)
        self._admission = Admission(
            cell.config.name, timing.period_s, timing.max_command_age_s, timing.lease_timeout_s
        )
        self._commands = Commands.from_cell(cell)
        grants = Grants(cell.config.name, self._admission, new_key)
        self._services = Services(self._admission, self._commands, self._events, grants)
        self._power = DrivePower(cell, plant, self._events)
        self._memory: Memory | None = None
        self._last_q: Array | None = None
        self._enabled_since: int | None = None
        self._trouble: Trouble | None = None
        self._reopened = False
        self._retiring = False
        self._perception = Perception(cell, control, self._commands, self._events)
        inbox = Inbox(link, self._admission, clock.now, timing.period_s)
        self._dispatcher = Dispatcher(
            inbox, self._admission, self._services, self._commands, self._events
        )

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
        self._retiring = True
        self._events.warning("retiring", "the daemon was told to end")

    def wait_in_boot(self, reason: str) -> None:
        """Answer operators while a device is missing, and tell them which."""
        now_s = self.clock.now()
        self.tick += 1
        self._events.at(self.tick, now_s)
        self._events.warning("device_missing", reason)
        self._dispatcher.take(self._look_around(now_s, self.plant.read(now_s)))
        self._publish_events()

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
        self._dispatcher.listen(Instant(self.clock.now(), self.tick, self._enabled_since))

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
        self.overruns += periods
        self._late_in_a_row = self._late_in_a_row + periods if periods else 0

    def finish(self) -> None:
        """Do one period's work; quick-stop if anything is raised."""
        now_s = self.clock.now()
        self._events.at(self.tick, now_s)
        try:
            self._finish(now_s)
        except Exception as error:  # noqa: BLE001  outermost: whatever it is, the arm stops
            words = f"{type(error).__name__}: {error}"
            self._quick_stop(Trouble(Cause.STATE_LOST, "daemon", words), "tick_raised")
        self._publish_events()

    def _publish_events(self) -> None:
        for event in self._events.take():
            self._link.publish(EVENT, encode(event))

    def _finish(self, now_s: float) -> None:
        reading = self.plant.read(now_s)
        view = self._look_around(now_s, reading)
        self._dispatcher.take(view)
        # Only now: what was just ordered was placed where arm and frames were together, a tick ago.
        moving = self.mode in (Mode.ENABLED, Mode.STOPPING)
        self._commands.frames.moved = self._perception.moving_frames.step(self.tick, moving=moving)
        trouble = self._faults.find(self.mode, reading, self.output)
        if trouble is not None and self.mode is not Mode.FAULT:
            self._quick_stop(trouble, "fault")
        self._change_mode(reading, trouble, view)
        if reading.q is not None:
            self._last_q = reading.q
            self._compute_and_write(now_s, reading, reading.q)
        if self._last_q is not None:
            # With a drive missing, operators still hear: where the joints were, and what is wrong.
            self._tell(now_s, reading, self._last_q)

    # --- operators ---------------------------------------------------------------------------

    def _look_around(self, now_s: float, reading: PlantReading) -> RequestContext:
        """Watch what is to be watched, and return what a request may depend on."""
        perception = self._perception
        perception.update(
            reading,
            self._memory,
            self.output,
            self.mode,
            now_s,
        )
        return RequestContext(
            now=Instant(now_s, self.tick, self._enabled_since),
            mode=self.mode,
            unloaded=perception.sensor.unloaded,
            still=perception.sensor.still,
            essential_stale=perception.sensor.missed,
            gain_bound=self._gain_bound,
            vision=perception.vision,
            obstacles=perception.obstacles,
            moving_frames=perception.moving_frames,
            T_world_mrf=None if self.output is None else self.output.T_world_mrf,
            T_wrist_mrf=None if self.output is None else self.output.T_wrist_mrf,
            touched=perception.collisions.stopping or perception.load.touched,
            drives_off=reading.off,
        )

    # --- faults and modes --------------------------------------------------------------------

    def _quick_stop(self, trouble: Trouble, name: str) -> None:
        """Stop every drive on its own ramp, now, and say why."""
        self.plant.quick_stop()
        self._trouble = trouble
        self.mode = Mode.FAULT
        self._enabled_since = None
        self._commands.clear()
        self._events.error(
            name,
            f"{trouble.device}: {trouble.detail}",
            **{"cause": str(trouble.cause), "device": trouble.device, **trouble.values},
        )

    def _change_mode(
        self, reading: PlantReading, trouble: Trouble | None, view: RequestContext
    ) -> None:
        services, before = self._services, self.mode
        reopen = before is Mode.FAULT and services.wish is Wish.RESET and not self._reopened
        if reopen:
            trouble = self._reopen(view.now)
        self._reopened = self._reopened and services.wish is Wish.RESET
        wrong = self.plant.buses.trouble
        if self._reopened and wrong is not None:
            services.finish_wish(view.now, Refused(Why.STILL_WRONG, wrong.detail))
        blocked = self._blocked(view, reading)
        if blocked not in (None, OVERRUNS) and before is Mode.READY:
            services.end_enable(view.now, blocked)
        self.mode = next_mode(
            before,
            ModeInputs(
                wish=Wish.DISABLE if self._retiring else services.wish,
                hold=services.hold,
                resume=services.resume,
                open=reading.q is not None and not reopen,  # what was read before is void then
                healthy=trouble is None,
                drives_enabled=reading.enabled,
                drives_off=reading.off,
                may_move=blocked is None,
                at_rest=self.output is not None and self.output.at_rest,
            ),
        )
        if self.mode is not before:
            self._entered(before, blocked)
        if self.mode is Mode.READY:
            self._switch_power(reading, view.now)
        services.settle(self.mode, view)

    def _switch_power(self, reading: PlantReading, now: Instant) -> None:
        try:
            blocked = self._power.follow(self._services.wish is Wish.ENABLE, reading)
        except DeviceError as error:
            self._services.finish_wish(now, Refused(Why.STILL_WRONG, str(error)))
            blocked = self._power.follow(False, reading)
        if blocked:
            self._keep_lease(now)

    def _keep_lease(self, now: Instant) -> None:
        """After what may block: a lease does not run out because nobody listened to its holder."""
        if self._admission.lease.alive(now.time_s):
            self._admission.renew(replace(now, time_s=self.clock.now()))

    def _entered(self, before: Mode, blocked: str | None) -> None:
        if self.mode is Mode.STOPPING:
            reason = blocked or ("hold asked" if self._services.hold else "disable asked")
            self._events.warning("stopping", reason, reason=reason)
        self._enabled_since = self.tick if self.mode is Mode.ENABLED else None
        if Mode.ENABLED in (self.mode, before):
            self._commands.clear()
        self._events.info("mode", f"{before} -> {self.mode}", mode=self.mode, before=before)

    def _blocked(self, view: RequestContext, reading: PlantReading) -> str | None:
        """Return why the arm may not move now, or None."""
        if self._retiring:
            return "daemon ends"
        if not self._admission.lease.alive(view.now.time_s):
            return "lease run out"
        if self._services.protective_stop is not None:
            return "protective stop"
        if reading.interlock is not None:
            return reading.interlock
        seen = self._perception.reason_to_stop()
        if seen is not None:
            return seen
        if self._late_in_a_row > self._tolerated_overruns:
            return OVERRUNS
        return None

    def _reopen(self, now: Instant) -> Trouble | None:
        """Configure all devices anew for a reset; return what is still wrong."""
        try:
            self.plant.open()
        except DeviceError as error:
            self._services.finish_wish(now, Refused(Why.STILL_WRONG, str(error)))
            return self._trouble
        finally:
            self._keep_lease(now)
        self.plant.reset()
        self._reopened = True
        self._trouble = self._memory = None
        return None

    # --- computing, writing, telling ---------------------------------------------------------

    def _compute_and_write(self, now_s: float, reading: PlantReading, q: Array) -> None:
        intent = INTENTS[self.mode]
        if self._memory is None:
            self._memory = self._control.seed(q)
        commands, perception, moving = self._commands, self._perception, intent is Intent.MOVE
        moved = commands.frames.moved if perception.moving_frames.watching else None
        T_world_mrf = self._control.pose_mrf(
            self._memory, commands.frames.T_wrist_mrf, None if moved is None else moved.base.T
        )
        asked, obstacles = commands.in_force(now_s, T_world_mrf), perception.obstacles
        inputs = Inputs(
            time_s=now_s,
            intent=intent,
            q_measured=q,
            settings=asked.settings,
            energised=np.array([s is DriveState.OPERATION_ENABLED for s in reading.states]),
            wrench_sensor=reading.wrench,
            wrench_age_s=reading.wrench_lag_s,
            wrench_mean=reading.wrench_over_period,
            stick=asked.stick if moving else None,
            jog=asked.jog if moving else None,
            goal=asked.goal if moving else None,
            paused=asked.paused,
            view=perception.vision.goal(commands.frames.moved.base.T) if moving else None,
            posture=asked.posture if moving else None,
            at_posture=asked.at_posture,
            wrench_desired=asked.wrench_desired,
            scene=obstacles.scene(self.tick) if obstacles.known else None,
            R_world_wrench=asked.R_world_wrench,
            moved=moved,
            ground="world" if moved is None else asked.ground,
            T_wrist_goal=asked.T_wrist_goal,
            pushed=None if moving else perception.collisions.pushed,
        )
        start = time.perf_counter()
        self._memory, self.output = self._control.tick(self._memory, inputs)
        self.compute_s = time.perf_counter() - start
        commands.reflect(self.output)
        self._perception.remember(self.tick, self.output)
        if self.output.stop_worsened:
            self._tell_worsened(self.output.gaps)
        if self.output.refusal is not None and self.mode is not Mode.FAULT:
            refused = Trouble(Cause.STATE_LOST, "gate", self.output.refusal)
            self._quick_stop(refused, "gate_refused")
        self.plant.write(self.output.command)
        self.plant.switch(commands.settings.outputs)
        if self.output.at_goal and commands.goals.posture is not None:
            commands.goals.finish_posture()
            self._events.info("posture_reached")
        elif commands.goals.at_rest and np.abs(self.output.twists["following"]).max() > LED:
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

    def _tell(self, now_s: float, reading: PlantReading, q: Array) -> None:
        if self.output is None:
            return
        state = report(
            self.tick,
            now_s,
            self.mode,
            reading,
            q,
            self.output,
            self._commands,
            self._admission,
            self._perception.vision,
            self._perception.moving_frames,
            self._services.protective_stop is not None,
            self.overruns,
            self._perception.collisions.external,
        )
        self._link.publish(STATE, encode(state))
        reflection = self._commands.handle.message(self.tick)
        if reflection is not None:
            self._link.publish(REFLECTION, encode(reflection))
        if self.tick % DESCRIBE_EVERY == 1:
            self._link.publish(DESCRIPTION, encode(describe(self.cell)))
