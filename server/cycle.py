"""One period of the daemon: SYNC; read, take commands, decide the mode, tick, write, tell."""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from ..config.load import Cell, UrdfJoint
from ..config.schema.null_space import OBJECTIVES
from ..drivers.device import Cause, Trouble
from ..protocols import topics as t
from ..protocols.codec import decode_as, encode
from ..protocols.messages.messages import JoystickTwist
from .commands.commands import Commands
from .control.arm import Arm
from .control.inputs import (
    Inputs,
    Intent,
    ObjectiveGains,
    PathGoal,
    Pursuit,
    StickCommand,
    TwistRoute,
    TwistSegment,
    ViewGoal,
)
from .control.joints import Joints, joined
from .control.proximity.pairs import Gap
from .control.spatial import Array
from .control.tick import Control
from .mode import Mode
from .operators.admission import Admission, Grants, Instant
from .operators.inbox import Inbox
from .operators.link import Link, opening_events
from .operators.requests import Dispatcher, RequestContext, Services
from .plant import Plant, PlantReading
from .process import Clock
from .recorder import BlackBox, Flight, FlightLog
from .supervisor import DrivePower, FaultDetector, Supervisor
from .telemetry import Telemetry, TickRecord, describe
from .units.units import Units

# --- Warm-up: ticks and messages with dummy inputs, so that the first real ones are not slow ------

TICKS = 20
"""Ticks of each intent that are computed [1]."""


def warm_up(cell: Cell, control: Control) -> None:
    """Run the tick with every kind of input, so that all of its code is loaded; keep nothing."""
    dummies = [_Dummy(part, arm) for part, arm in zip(cell.parts, control.arms, strict=True)]
    for intent in Intent:
        memory = control.seed(np.concatenate([dummy.q for dummy in dummies]))
        for i in range(TICKS):
            q = memory.commanded.motion.q
            inputs = [
                dummy.inputs(q[part], intent, i / TICKS)
                for dummy, part in zip(dummies, control.parts, strict=True)
            ]
            memory, _ = control.tick(memory, inputs)
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
        self._settings = replace(commands.settings.for_control(), objectives=every)
        self._moved = commands.frames.moved if commands.frames.movable else None
        self._stick = StickCommand(np.full(6, 0.01), np.eye(3))

    def inputs(self, q_command: Array, intent: Intent, way: float) -> Inputs:
        """Return the inputs of a tick; `way` from 0 to 1 goes through the kinds of goals."""
        mrf = self._settings.T_wrist_mrf
        T = self._arm.mechanism.pose_wrist(q_command) @ mrf
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


# --- One period of the daemon: SYNC; read, take commands, decide the mode, tick, write, tell ------
#
# `begin` sends SYNC k at its deadline; `finish` does the rest once the drives have answered.
# Every cycle ends in a safe command: whatever is raised on the way ends in a quick stop of
# every drive.


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
        box: BlackBox | None = None,
    ) -> None:
        """Build it; `box` keeps the last seconds before faults and stops, None for nowhere."""
        name, timing = cell.config.name, cell.config.timing
        self.tick = 0
        self.compute_s = 0.0
        """Time that the last control computation took [s]."""
        self.cell, self.plant, self.clock = cell, plant, clock
        self._control, self._link = control, link
        self._heartbeat_every = max(1, int(timing.heartbeat_period_s / timing.period_s))
        self._last_q: Array | None = None
        self.events = self._events = events = opening_events(cell.config.zenoh)
        self._admission = admission = Admission(
            name, timing.period_s, timing.max_command_age_s, timing.lease_timeout_s
        )
        self.units = units = Units.from_cell(cell, control, events)
        """The units: commands, perception and results of each arm."""
        services = Services(admission, events, Grants(name, admission, new_key))
        self._services = services
        inbox = Inbox(link, admission, clock.now, timing.period_s)
        self._dispatcher = Dispatcher(inbox, admission, services, units, events)
        self._supervisor = Supervisor(
            plant,
            FaultDetector(
                Joints.of_all([arm.p.joints for arm in control.arms]),
                [drive for part in cell.parts for drive in part.config.mechanism.drives],
            ),
            DrivePower(_joints(cell), plant, events, units.holding),
            services,
            admission,
            units,
            events,
            clock.now,
            timing.tolerated_overruns,
        )
        self._telemetry = Telemetry(describe(cell), link, events)
        log = FlightLog(timing.period_s, len(units.each), clock.wall_ns)
        self._unwell: Mapping[str, Trouble] = {}
        """What was wrong a tick ago with devices that stop nothing."""
        self.flight = Flight(log, events, box)
        """The last ticks: what went in, and what came out."""

    @property
    def mode(self) -> Mode:
        """The mode that the last tick decided."""
        return self._supervisor.mode

    @property
    def following_error(self) -> Array | None:
        """How far all joints (n,) are behind their commands [rad]; None before the first tick."""
        return self.units.following_error

    def publish_ticks(self) -> None:
        """Tell on the network what each tick looked at and decided, while somebody listens."""
        self.flight.log.taps.append(self._telemetry.publish_tick)

    def boot(self) -> None:
        """Configure every device; blocks. Raises `DeviceError`."""
        self.plant.open()

    def warm_up(self) -> None:
        """Run through a tick's code once, so that the first real one is not slow."""
        warm_up(self.cell, self._control)
        for unit in self.units.each:
            unit.commands.settings.bounds.payloads.prepare()

    def close(self) -> None:
        """Stop and release everything, whatever state it is in."""
        self.plant.close()
        self.flight.close()
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
        self._dispatcher.take(self._perceive(now_s, self.plant.read(now_s)))
        self._telemetry.publish_events()

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
        """Send SYNC, and now and then the heartbeat that only a living tick produces.

        Before it goes the quick stop of all drives, if one told of an emergency since the last
        tick, or a bus left the last SYNC unanswered: they obey it with this SYNC, a period before
        they would by what is read after it.
        """
        self.tick += 1
        trouble = self.plant.emergency() if self.mode.energised else None
        if trouble is not None:
            self._events.at(self.tick, self.clock.now())
            self._supervisor.quick_stop(trouble, "fault")
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
        self.flight.end(self.tick, self.mode)
        self._telemetry.publish_events()

    def _finish(self, now_s: float) -> None:
        units, reading = self.units, self.plant.read(now_s)
        if reading.unwell is not self._unwell:
            self._tell_unwell(reading.unwell)
        context = self._perceive(now_s, reading)
        self._dispatcher.take(context)
        # Only now: what was just commanded was placed where arm and frames were together, a tick
        # ago.
        for unit in units.each:
            unit.follow_frames(self.tick, self.mode)
        reason = reading.interlock or units.reason_to_stop
        if self._supervisor.update(reading, context, reason):
            units.forget()
        if reading.q is not None:
            self._last_q = reading.q
            self._compute_and_write(now_s, reading, reading.q)
        if self._last_q is not None:
            # With a drive missing, operators still hear: where the joints were, and what is wrong.
            record = TickRecord(
                self.tick,
                now_s,
                self.mode,
                reading,
                self._last_q,
                self._services.stops.asked_by is not None,
                self._supervisor.overruns,
            )
            self._telemetry.publish(record, units, self._admission)

    def _tell_unwell(self, unwell: Mapping[str, Trouble]) -> None:
        """Tell of devices that stop nothing when something is wrong with them, and when not."""
        before, self._unwell = self._unwell, unwell
        for name, trouble in unwell.items():
            if name not in before or before[name].cause is not trouble.cause:
                self._events.warning(
                    "device_unwell",
                    f"{name}: {trouble.detail}",
                    **{"device": name, "cause": str(trouble.cause), **trouble.values},
                )
        for name in [name for name in before if name not in unwell]:
            self._events.info("device_well", name, device=name)

    def _quick_stop(self, device: str, words: str, event: str) -> None:
        self._supervisor.quick_stop(Trouble(Cause.STATE_LOST, device, words), event)

    def _perceive(self, now_s: float, reading: PlantReading) -> RequestContext:
        """Update all monitors, and return what a request may depend on."""
        for unit, own in zip(self.units.each, reading.units, strict=True):
            unit.perceive(own, self.mode, now_s)
        self.units.look_around(self.tick)
        now = Instant(now_s, self.tick, self._supervisor.enabled_since)
        return RequestContext(now, self.mode, self.units, reading.off)

    def _compute_and_write(self, now_s: float, reading: PlantReading, q: Array) -> None:
        units, memory = self.units.each, self.units.memory
        if memory is None:
            memory = self._control.seed(q, self.units.held)
        told = memory.commanded.motion.q
        self.units.stand(memory.commanded.motion, q)
        inputs = [
            unit.inputs(
                told[unit.joints], self.mode, self.tick, now_s, own, q[unit.joints],
                self.units.obstacles,
            )
            for unit, own in zip(units, reading.units, strict=True)
        ]  # fmt: skip
        places = {unit.mechanism: i for i, unit in enumerate(units)}
        holding = [(places[j.units[0].mechanism], j) for j in self.units.joint if j.on]
        for i, joint in holding:
            own, part = reading.units[i], units[i].joints
            inputs[i] = joint.inputs(
                self.mode, self.tick, now_s, own, q[part], self.units.obstacles
            )
        start = time.perf_counter()
        keep = partial(self.flight.log.keep, self.tick, now_s, self.mode, memory, inputs)
        try:
            after, outputs = self._control.tick(memory, inputs)
        except Exception:
            keep(None, ())
            raise
        self.compute_s = time.perf_counter() - start
        if outputs[0].stop_worsened:
            self._tell_worsened(outputs[0].gaps)
        refusal = next((o.refusal for o in outputs if o.refusal is not None), None)
        if refusal is not None and self.mode is not Mode.FAULT:
            self._quick_stop("gate", refusal, "gate_refused")
        self.plant.write(joined([output.command for output in outputs]))
        for unit in units:
            self.plant.switch(unit.outputs)
        self.units.keep(self.tick, after, outputs)
        for i, joint in holding:
            joint.keep(outputs[i].shared)
        keep(after, outputs)

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


def _joints(cell: Cell) -> tuple[UrdfJoint, ...]:
    """Return all joints of a cell by the names that they have in it."""
    return tuple(
        replace(joint, name=f"{part.prefix}{joint.name}")
        for part in cell.parts
        for joint in part.robot.joints
    )
