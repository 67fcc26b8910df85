"""Supervisor: decides the mode in every tick, switches the drives' power, and stops them."""

from collections.abc import Callable
from dataclasses import replace

from ..drivers.device import DeviceError, Trouble
from .faults import FaultDetector
from .mode import Mode, ModeInputs, PendingAction, next_mode
from .operators.admission import Admission, Instant
from .operators.request_context import RequestContext
from .operators.services import Services
from .plant import Plant, PlantReading
from .power import DrivePower
from .refusals import Refused, Why
from .runtime.events import Events
from .units.units import Units

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
        if self._services.protective_stop is not None:
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
