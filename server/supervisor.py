"""Supervisor: decides the mode in every tick by the faults, switches the drives' power, stops."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..config.load import UrdfJoint
from ..config.schema.mechanism import DriveSection
from ..drivers.device import Cause, DeviceError, Trouble
from ..protocols.canopen.cia402 import DriveState
from .control.joints import Joints
from .control.spatial import Array, exceeds
from .events import Events
from .mode import Mode, ModeInputs, PendingAction, next_mode
from .operators.admission import Admission, Instant
from .operators.requests import RequestContext, Services
from .plant import Plant, PlantReading
from .refusals import Refused, Why
from .units.units import Units

# --- Fault detection: devices in trouble, drives that left Operation enabled, joints left behind


class FaultDetector:
    """Detects faults that call for a quick stop."""

    def __init__(self, joints: Joints, drives: Sequence[DriveSection]) -> None:
        """Build it for all joints of a cell, and their drives in the same order."""
        self._joints, self._window = joints.names, joints.following_window
        self._nodes = tuple(drive.node for drive in drives)

    def find(
        self, mode: Mode, reading: PlantReading, following_error: Array | None
    ) -> Trouble | None:
        """Return what is wrong now, or None; `following_error` (n,) is the last tick's [rad]."""
        if reading.trouble is not None or not mode.energised:
            return reading.trouble
        if reading.states.count(DriveState.OPERATION_ENABLED) < len(reading.states):
            return self._elsewhere(mode, reading)
        if following_error is not None and exceeds(following_error, self._window):
            return self._left_behind(np.abs(following_error))
        return None

    def _elsewhere(self, mode: Mode, reading: PlantReading) -> Trouble:
        """Return which drive is not in Operation enabled, though the mode says that all are."""
        j = next(i for i, s in enumerate(reading.states) if s is not DriveState.OPERATION_ENABLED)
        state = reading.states[j]
        there = "no state" if state is None else state.name.lower()
        return Trouble(
            Cause.STATE_LOST,
            self._joints[j],
            f"the mode is {mode}, the drive is in {there}",
            {"node": self._nodes[j]},
        )

    def _left_behind(self, error: Array) -> Trouble:
        """Return which joint is too far from its command, of how far all are (n,) [rad]."""
        j = int(np.argmax(error / self._window))
        return Trouble(
            Cause.FOLLOWING_ERROR,
            self._joints[j],
            f"command and joint are {error[j]:.4f} rad apart, at most {self._window[j]:.4f}",
            {"node": self._nodes[j], "error_rad": float(error[j])},
        )


# --- Power of the drives: switched on and off with the mode, step by step with their states -------
#
# The arm is enabled from drives that are off: each is given room for where its joint stands,
# and the torque that holds it there, and then led to Operation enabled.

OUTSIDE = 1e-4
"""A joint is outside its limit from here on: less is what an encoder rounds [rad]."""


class DrivePower:
    """Switches the drives of one cell; `holding` returns the torques (n,) that hold joints (n,)."""

    def __init__(
        self,
        joints: tuple[UrdfJoint, ...],
        plant: Plant,
        events: Events,
        holding: Callable[[Array], Array],
    ) -> None:
        self._plant, self._events, self._holding = plant, events, holding
        self._joints = joints
        self._begun = False

    def follow(self, on: bool, reading: PlantReading) -> bool:
        """Lead the drives on, or off; where they are still on their way off, that comes first.

        For READY, every tick. Returns whether it blocked, while a drive was prepared; raises
        `DeviceError` where one cannot be.
        """
        blocked = False
        if not on:
            self._begun = False
        elif not self._begun and reading.off and reading.q is not None:
            self._tell_outside(reading.q)
            blocked = self._plant.prepare(self._holding(reading.q))
            self._begun = True
        if self._begun:
            self._plant.enable()
        else:
            self._plant.disable()
        return blocked

    def _tell_outside(self, q: Array) -> None:
        """Name every joint that stands outside its limits, and by how much."""
        for joint, angle in zip(self._joints, q.tolist(), strict=True):
            beyond = max(joint.lower - angle, angle - joint.upper)
            if beyond > OUTSIDE:
                limit = joint.lower if angle < joint.lower else joint.upper
                self._events.warning(
                    "outside_limit",
                    f"{joint.name}: {beyond:.4f} rad beyond {limit:.4f}: it can only be moved back",
                    joint=joint.name,
                    beyond_rad=beyond,
                    position_rad=angle,
                    limit_rad=limit,
                )


# --- Supervisor: decides the mode in every tick, switches the drives' power, and stops them -------

OVERRUNS = "overruns"
"""Why the arm stops when ticks were late: no reason to give up enabling it, which moves nothing."""


class Supervisor:
    """The mode of one cell, and everything that changes it."""

    def __init__(
        self,
        plant: Plant,
        faults: FaultDetector,
        power: DrivePower,
        services: Services,
        admission: Admission,
        units: Units,
        events: Events,
        clock: Callable[[], float],
        tolerated_overruns: int,
    ) -> None:
        self.mode = Mode.BOOT
        self.enabled_since: int | None = None
        """Tick of the last enable or resume, None while not ENABLED."""
        self.overruns = 0
        """Deadlines that passed unserved."""
        self.retiring = False
        """The daemon is about to end: the arm may not move any more."""
        self._plant, self._faults, self._power = plant, faults, power
        self._services, self._modes = services, services.modes
        self._admission, self._units, self._events = admission, units, events
        self._clock = clock
        self._tolerated_overruns = tolerated_overruns
        self._late_in_a_row = 0
        self._trouble: Trouble | None = None
        self._reopened = False

    def missed(self, periods: int) -> None:
        """Count deadlines that passed unserved before this tick; 0 for a tick in time."""
        self.overruns += periods
        self._late_in_a_row = self._late_in_a_row + periods if periods else 0

    def quick_stop(self, trouble: Trouble, name: str) -> None:
        """Stop every drive on its own ramp, now, and tell why by an event of that name."""
        self._plant.quick_stop(self._units.stop_ramps)
        self._trouble = trouble
        self.mode = Mode.FAULT
        self.enabled_since = None
        self._units.clear()
        self._events.error(
            name,
            f"{trouble.device}: {trouble.detail}",
            **{"cause": str(trouble.cause), "device": trouble.device, **trouble.values},
        )

    def update(
        self,
        reading: PlantReading,
        context: RequestContext,
        reason_to_stop: str | None,
    ) -> bool:
        """Decide the mode of this tick, and answer the requests that waited for it.

        `reason_to_stop` is that of an interlock or of perception.
        Returns True where the devices were configured anew: what was computed before is void.
        """
        trouble = self._faults.find(self.mode, reading, self._units.following_error)
        if trouble is not None and self.mode is not Mode.FAULT:
            self.quick_stop(trouble, "fault")
        modes, before, now = self._modes, self.mode, context.now
        reopen = before is Mode.FAULT and modes.action is PendingAction.RESET and not self._reopened
        if reopen:
            trouble = self._reopen(now)
        void = reopen and self._reopened
        self._reopened = self._reopened and modes.action is PendingAction.RESET
        wrong = self._plant.buses.trouble
        if self._reopened and wrong is not None:
            modes.finish(now, Refused(Why.STILL_WRONG, wrong.detail))
        blocked = self._blocked(now, reason_to_stop)
        if blocked not in (None, OVERRUNS) and before is Mode.READY:
            modes.end_enable(now, blocked)
        self.mode = next_mode(
            before,
            ModeInputs(
                action=PendingAction.DISABLE if self.retiring else modes.action,
                hold=modes.hold,
                resume=modes.resume,
                open=reading.q is not None and not reopen,  # what was read before is void then
                healthy=trouble is None,
                drives_enabled=reading.enabled,
                drives_off=reading.off,
                may_move=blocked is None,
                at_rest=self._units.at_rest,
            ),
        )
        if self.mode is not before:
            self._entered(before, blocked, now.tick)
        if self.mode is Mode.READY:
            self._switch_power(reading, now)
        modes.settle(self.mode, context)
        return void

    def _blocked(self, now: Instant, reason_to_stop: str | None) -> str | None:
        """Return why the arm may not move now, or None."""
        if self.retiring:
            return "daemon ends"
        if not self._admission.lease.alive(now.time_s):
            return "lease run out"
        if self._services.stops.asked_by is not None:
            return "protective stop"
        if reason_to_stop is not None:
            return reason_to_stop
        return OVERRUNS if self._late_in_a_row > self._tolerated_overruns else None

    def _reopen(self, now: Instant) -> Trouble | None:
        """Configure all devices anew for a reset; return what is still wrong."""
        try:
            self._plant.open()
        except DeviceError as error:
            self._modes.finish(now, Refused(Why.STILL_WRONG, str(error)))
            return self._trouble
        finally:
            self._keep_lease(now)
        self._plant.reset()
        self._reopened = True
        self._trouble = None
        return None

    def _switch_power(self, reading: PlantReading, now: Instant) -> None:
        try:
            blocked = self._power.follow(self._modes.action is PendingAction.ENABLE, reading)
        except DeviceError as error:
            self._modes.finish(now, Refused(Why.STILL_WRONG, str(error)))
            blocked = self._power.follow(False, reading)
        if blocked:
            self._keep_lease(now)

    def _keep_lease(self, now: Instant) -> None:
        """After what may block: a lease does not run out because nobody listened to its holder."""
        if self._admission.lease.alive(now.time_s):
            self._admission.renew(replace(now, time_s=self._clock()))

    def _entered(self, before: Mode, blocked: str | None, tick: int) -> None:
        if self.mode is Mode.STOPPING:
            reason = blocked or ("hold asked" if self._modes.hold else "disable asked")
            self._events.warning("stopping", reason, reason=reason)
        self.enabled_since = tick if self.mode is Mode.ENABLED else None
        if Mode.ENABLED in (self.mode, before):
            self._units.clear()
        self._events.info("mode", f"{before} -> {self.mode}", mode=self.mode, before=before)
