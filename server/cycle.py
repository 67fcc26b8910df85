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
from .commands.commands import Orders
from .control.barriers.clearance import Gap
from .control.spatial import Array, Pose
from .control.state import Inputs, Intent, Memory, Output
from .control.tick import Control
from .faults import Faults
from .mode import Mode, Situation, Wish, next_mode
from .operators.admission import Admission, Now
from .operators.exposure import opening_events
from .operators.grants import Grants
from .operators.inbox import Reception
from .operators.intake import Intake
from .operators.link import Link
from .operators.services import Desk, View
from .perception.perception import Watches
from .plant import Plant, PlantReading
from .power import Power
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
        self._faults = Faults(cell, control.p)
        self._late_in_a_row = 0
        self._tolerated_overruns = timing.tolerated_overruns
        self._heartbeat_every = max(1, int(timing.heartbeat_period_s / timing.period_s))
        self._events = opening_events(cell)
        self._admission = Admission(
            cell.config.name, timing.period_s, timing.max_command_age_s, timing.lease_timeout_s
        )
        self._orders = Orders(cell)
        grants = Grants(cell.config.name, self._admission, new_key)
        self._desk = Desk(self._admission, self._orders, self._events, grants)
        self._power = Power(cell, plant, self._events)
        self._memory: Memory | None = None
        self._last_q: Array | None = None
        self._enabled_since: int | None = None
        self._trouble: Trouble | None = None
        self._reopened = False
        self._retiring = False
        self._watches = Watches(cell, control, self._orders, self._events)
        reception = Reception(link, self._admission, clock.now, timing.period_s)
        self._intake = Intake(reception, self._admission, self._desk, self._orders, self._events)

    def boot(self) -> None:
        """Configure every device; blocks. Raises `DeviceError`."""
        self.plant.open()

    def warm_up(self) -> None:
        """Run through a tick's code once, so that the first real one is not slow."""
        warm_up(self.cell, self._control)
        self._orders.tuning.payload_judge.prepare()

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
        self._intake.take(self._look_around(now_s, self.plant.read(now_s)))
        self._publish_events()

    @property
    def placed_target(self) -> tuple[str, Pose] | None:
        """Where the position source is to bring the MRF, if anywhere: a ground, a pose on it."""
        return self._orders.placed_target

    @property
    def T_wrist_mrf(self) -> Pose:
        """The MRF that is in force."""
        return self._orders.places.T_wrist_mrf

    @property
    def pressed(self) -> bool:
        """True while so much junk comes in that it should be sorted more than once a period."""
        return self._intake.pressed

    def listen(self) -> None:
        """Sort what has come in from the network, between two ticks' work."""
        self._intake.listen(Now(self.clock.now(), self.tick, self._enabled_since))

    def gather(self) -> None:
        """Take in what has come by now: a late answer shall not pass for one to the next SYNC."""
        self.plant.fieldbus.receive(self.clock.now())

    def begin(self) -> None:
        """Send SYNC, and now and then the heartbeat that only a living tick produces."""
        self.tick += 1
        self.plant.sync()
        if self.tick % self._heartbeat_every == 0:
            self.plant.fieldbus.heartbeat()

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
        self._intake.take(view)
        # Only now: what was just ordered was placed where arm and frames were together, a tick ago.
        moving = self.mode in (Mode.ENABLED, Mode.STOPPING)
        self._orders.places.moved = self._watches.frames.step(self.tick, moving=moving)
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

    def _look_around(self, now_s: float, reading: PlantReading) -> View:
        """Watch what is to be watched, and return what a request may depend on."""
        watches = self._watches
        watches.look(
            reading,
            self._memory,
            self.output,
            self.plant.sensor is not None and self.plant.opened,
            self.mode,
            now_s,
        )
        return View(
            now=Now(now_s, self.tick, self._enabled_since),
            mode=self.mode,
            unloaded=watches.sensor.unloaded,
            still=watches.sensor.still,
            essential_stale=watches.sensor.missed,
            gain_bound=self._gain_bound,
            vision=watches.vision,
            world=watches.world,
            frames=watches.frames,
            T_world_mrf=None if self.output is None else self.output.T_world_mrf,
            T_wrist_mrf=None if self.output is None else self.output.T_wrist_mrf,
            touched=watches.touch.stopping or watches.load.touched,
            drives_off=reading.off,
        )

    # --- faults and modes --------------------------------------------------------------------

    def _quick_stop(self, trouble: Trouble, name: str) -> None:
        """Stop every drive on its own ramp, now, and say why."""
        self.plant.quick_stop()
        self._trouble = trouble
        self.mode = Mode.FAULT
        self._enabled_since = None
        self._orders.clear()
        self._events.error(
            name,
            f"{trouble.device}: {trouble.detail}",
            **{"cause": str(trouble.cause), "device": trouble.device, **trouble.values},
        )

    def _change_mode(self, reading: PlantReading, trouble: Trouble | None, view: View) -> None:
        desk, before = self._desk, self.mode
        reopen = before is Mode.FAULT and desk.wish is Wish.RESET and not self._reopened
        if reopen:
            trouble = self._reopen(view.now)
        self._reopened = self._reopened and desk.wish is Wish.RESET
        if self._reopened and self.plant.fieldbus.trouble is not None:
            desk.finish_wish(view.now, Refused(Why.STILL_WRONG, self.plant.fieldbus.trouble.detail))
        blocked = self._blocked(view)
        if blocked not in (None, OVERRUNS) and before is Mode.READY:
            desk.end_enable(view.now, blocked)
        self.mode = next_mode(
            before,
            Situation(
                wish=Wish.DISABLE if self._retiring else desk.wish,
                hold=desk.hold,
                resume=desk.resume,
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
        desk.settle(self.mode, view)

    def _switch_power(self, reading: PlantReading, now: Now) -> None:
        try:
            blocked = self._power.follow(self._desk.wish is Wish.ENABLE, reading)
        except DeviceError as error:
            self._desk.finish_wish(now, Refused(Why.STILL_WRONG, str(error)))
            blocked = self._power.follow(False, reading)
        if blocked:
            self._keep_lease(now)

    def _keep_lease(self, now: Now) -> None:
        """After what may block: a lease does not run out because nobody listened to its holder."""
        if self._admission.lease.alive(now.time_s):
            self._admission.renew(replace(now, time_s=self.clock.now()))

    def _entered(self, before: Mode, blocked: str | None) -> None:
        if self.mode is Mode.STOPPING:
            reason = blocked or ("hold asked" if self._desk.hold else "disable asked")
            self._events.warning("stopping", reason, reason=reason)
        self._enabled_since = self.tick if self.mode is Mode.ENABLED else None
        if Mode.ENABLED in (self.mode, before):
            self._orders.clear()
        self._events.info("mode", f"{before} -> {self.mode}", mode=self.mode, before=before)

    def _blocked(self, view: View) -> str | None:
        """Return why the arm may not move now, or None."""
        if self._retiring:
            return "daemon ends"
        if not self._admission.lease.alive(view.now.time_s):
            return "lease run out"
        if self._desk.protective_stop is not None:
            return "protective stop"
        seen = self._watches.reason_to_stop()
        if seen is not None:
            return seen
        if self._late_in_a_row > self._tolerated_overruns:
            return OVERRUNS
        return None

    def _reopen(self, now: Now) -> Trouble | None:
        """Configure all devices anew for a reset; return what is still wrong."""
        try:
            self.plant.open()
        except DeviceError as error:
            self._desk.finish_wish(now, Refused(Why.STILL_WRONG, str(error)))
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
        orders, watches, moving = self._orders, self._watches, intent is Intent.MOVE
        moved = orders.places.moved if watches.frames.watching else None
        T_world_mrf = self._control.pose_mrf(
            self._memory, orders.places.T_wrist_mrf, None if moved is None else moved.base.T
        )
        inputs = Inputs(
            time_s=now_s,
            intent=intent,
            q_measured=q,
            settings=orders.settings(),
            energised=np.array([s is DriveState.OPERATION_ENABLED for s in reading.states]),
            wrench_sensor=reading.wrench,
            wrench_age_s=reading.wrench_lag_s,
            wrench_mean=reading.wrench_over_period,
            stick=orders.stick(now_s, T_world_mrf) if moving else None,
            jog=orders.jog(now_s) if moving else None,
            goal=orders.goal if moving else None,
            paused=orders.paused,
            view=watches.vision.goal(orders.places.moved.base.T) if moving else None,
            posture=orders.posture if moving else None,
            at_posture=orders.at_rest,
            wrench_desired=orders.wrench_desired,
            scene=watches.world.scene(self.tick) if watches.world.known else None,
            R_world_wrench=orders.wrench_axes(T_world_mrf),
            moved=moved,
            ground="world" if moved is None else orders.ground(now_s),
            T_wrist_goal=orders.T_wrist_goal,
            pushed=None if moving else watches.touch.pushed,
        )
        start = time.perf_counter()
        self._memory, self.output = self._control.tick(self._memory, inputs)
        self.compute_s = time.perf_counter() - start
        orders.reflect(self.output)
        self._watches.remember(self.tick, self.output)
        if self.output.stop_worsened:
            self._tell_worsened(self.output.gaps)
        if self.output.refusal is not None and self.mode is not Mode.FAULT:
            refused = Trouble(Cause.STATE_LOST, "gate", self.output.refusal)
            self._quick_stop(refused, "gate_refused")
        self.plant.write(self.output.command)
        self.plant.grip(orders.tuning.gripper_closed)
        if self.output.at_goal and orders.posture is not None:
            orders.finish_posture()
            self._events.info("posture_reached")
        elif orders.at_rest and np.abs(self.output.twists["following"]).max() > LED:
            orders.led_by_hand()

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
            self._orders,
            self._admission,
            self._watches.vision,
            self._watches.frames,
            self._desk.protective_stop is not None,
            self.overruns,
            self._watches.touch.external,
        )
        self._link.publish(STATE, encode(state))
        reflection = self._orders.reflection(self.tick)
        if reflection is not None:
            self._link.publish(REFLECTION, encode(reflection))
        if self.tick % DESCRIBE_EVERY == 1:
            self._link.publish(DESCRIPTION, encode(describe(self.cell)))
