"""The simulated CiA 402 servo drive in CSP, CSV and CST, with a holding brake."""

from collections.abc import Callable
from typing import Final, NamedTuple, Self, cast

from ....config.schema.bus import Entry
from ....config.schema.mechanism import DriveSection
from ....config.schema.rig import RigDriveSection
from ....protocols.canopen import cia402
from ....protocols.canopen.can301 import Abort, EmcyCode
from ....protocols.canopen.cia402 import (
    AbortConnectionOption,
    DriveState,
    Object,
    OperationMode,
    Status,
    wrapped,
)
from ....protocols.messages.rig import MOST_FORCE, MOST_FRICTION, RigFault, value_of, vector_of
from ..physics.movers import GRIP
from ..physics.world import World
from .canopen import NEVER, CanNode, ObjectStore, Pdo, RefusedError
from .drive_loops import DriveLoops
from .node import Bench, NodeLink

# --- From the objects of a simulated drive to the reference and the bounds of its loop ------------

_UNLIMITED: Final = 0xFFFFFFFF
_TARGET_POSITION: Final = (Object.TARGET_POSITION, 0)
_CONTROLWORD: Final = (Object.CONTROLWORD, 0)
_STATUSWORD: Final = (Object.STATUSWORD, 0)
_MODE_DISPLAY: Final = (Object.MODE_DISPLAY, 0)
_SETPOINT_TIMEOUT: Final = (Object.SETPOINT_TIMEOUT, 0)


class Interpolation(NamedTuple):
    """How a drive takes a position that it is sent: within its limits, over a period."""

    low: int
    """[counts]"""
    high: int
    """[counts]"""
    period_s: float


def follow(
    mode: int,
    objects: ObjectStore,
    interpolation: Interpolation,
    loop: DriveLoops,
    joint: int,
    drive: DriveSection,
    *,
    streamed: bool = True,
) -> bool:
    """Follow the newest setpoint of the mode; return whether the drive's limits cut it.

    `streamed`: more are to come, one every period.
    """
    scale = drive.direction * drive.counts_per_radian
    if mode == OperationMode.CSP:
        counts = objects.image[_TARGET_POSITION]
        low, high, period_s = interpolation
        kept = min(max(counts, low), high)
        target = drive.zero_rad + kept / scale
        return loop.aim(joint, target, period_s, streamed=streamed) or kept != counts
    if mode == OperationMode.CSV:
        counts = objects[Object.TARGET_VELOCITY, 0] + objects[Object.VELOCITY_OFFSET, 0]
        return loop.run(joint, counts / scale)
    share = (objects[Object.TARGET_TORQUE, 0] + objects[Object.TORQUE_OFFSET, 0]) * 1e-3
    return loop.pull(joint, share * drive.direction * drive.rated_torque)


def tune(
    mode: int, objects: ObjectStore, loop: DriveLoops, joint: int, drive: DriveSection
) -> Interpolation:
    """Take over the following window of the mode, the torque offset and the bound of torque.

    Returns how positions are to be taken.
    """
    loop.window[joint] = window(mode, objects, drive)
    share = objects[Object.TORQUE_OFFSET, 0] * 1e-3
    loop.offset[joint] = share * drive.direction * drive.rated_torque
    bound = objects[Object.MAX_TORQUE, 0]
    reached = bound >= most_torque(drive)
    loop.max_torque[joint] = drive.max_torque if reached else bound * 1e-3 * drive.rated_torque
    low, high = objects[Object.POSITION_LIMIT, 1], objects[Object.POSITION_LIMIT, 2]
    value, power = (objects[Object.INTERPOLATION_PERIOD, i] for i in (1, 2))
    return Interpolation(low, high, value * 10.0**power)


def most_torque(drive: DriveSection) -> int:
    """Return the most that 6072h may be [1/1000 of the rated torque]."""
    return round(drive.max_torque / drive.rated_torque * 1000)


def window(mode: int, objects: ObjectStore, drive: DriveSection) -> float:
    """Return the following error that is too much [rad]; only a position setpoint has any."""
    counts = objects[Object.FOLLOWING_WINDOW, 0]
    if mode != OperationMode.CSP or counts == _UNLIMITED:
        return float("inf")
    return counts / drive.counts_per_radian


def deceleration(objects: ObjectStore, drive: DriveSection) -> float:
    """Return the quick stop's ramp [rad/s²]."""
    counts = objects[Object.QUICK_STOP_DECELERATION, 0]
    return float(max(1, counts) / drive.counts_per_radian)


# --- Mechanical faults of a joint: blocked, braked, pushed ----------------------------------------


def inject_at_joint(fault: RigFault, world: World, joint: int, drive: DriveSection) -> None:
    """Apply a fault to a joint of the physics. Raises `ValueError` for one that it has not."""
    if fault.kind == "block":
        world.set_jam(joint, jammed=fault.on)
    elif fault.kind == "stick":
        half = drive.max_torque / 2
        torque = value_of(fault, 0.0, MOST_FRICTION, "N·m", default=half)
        world.set_extra_friction(joint, torque if fault.on else 0.0)
    elif fault.kind == "slip":
        friction = value_of(fault, 0.0, GRIP, "", default=0.05)
        world.set_grip(joint, friction if fault.on else None)
    elif fault.kind == "push":
        world.push_joint(joint, vector_of(fault, MOST_FORCE, "N") if fault.on else None)
    else:
        raise ValueError(f"fault {fault.kind}: its target is force_torque, not a joint")


# --- Objects of a simulated drive that are measured when they are read ----------------------------

_I16: Final = 2**15 - 1
_REACHED_RAD: Final = 1e-3


class Measured:
    """One joint as its drive's encoder and current sensor tell it, in the drive's own units."""

    def __init__(self, drive: DriveSection, joint: int, loop: DriveLoops, world: World) -> None:
        self._joint, self._loop, self._world = joint, loop, world
        self._scale, self._zero = drive.direction * drive.counts_per_radian, drive.zero_rad
        self._rated, self._direction = drive.rated_torque, drive.direction

    @property
    def objects(self) -> dict[tuple[int, int], Callable[[], int]]:
        """What measures each of its objects."""
        return {
            (Object.POSITION_ACTUAL, 0): self._position,
            (Object.POSITION_DEMAND, 0): lambda: self._position(self._error),
            (Object.VELOCITY_ACTUAL, 0): lambda: round(self._scale * self._speed),
            (Object.FOLLOWING_ERROR, 0): lambda: round(self._scale * self._error),
            (Object.TORQUE_ACTUAL, 0): self._torque,
            (Object.RATED_TORQUE, 0): lambda: round(self._rated * 1000),
        }

    @property
    def reached(self) -> bool:
        """Whether the joint stands at its reference."""
        return abs(self._error) < _REACHED_RAD and self._loop.at_rest(self._joint)

    @property
    def _speed(self) -> float:
        speed: float = self._world.dq.item(self._joint)
        return speed

    @property
    def _error(self) -> float:
        error: float = self._loop.error.item(self._joint)
        return error

    def _position(self, ahead: float = 0.0) -> int:
        world, joint = self._world, self._joint
        angle = world.q.item(joint) + world.ahead_s * world.dq.item(joint)
        return wrapped(round(self._scale * (angle + ahead - self._zero)))

    def _torque(self) -> int:
        share: float = self._loop.reported.item(self._joint) / self._rated * self._direction
        return max(-_I16, min(_I16, round(share * 1000)))


# --- Power stage and brake of one simulated drive: who holds the joint, and when that changes -----
#
# A drive that is set rightly holds the joint before it opens the brake, and until the brake has
# closed; one that is set wrongly (`torque_delay_s`) opens the brake first, and the joint sags.


class PowerStage:
    """Engages and releases the loop of one joint, and moves its brake.

    `on_held` is called where a setpoint that is there already is to act, before the drive follows:
    the torque of CST.
    """

    def __init__(
        self,
        joint: int,
        loop: DriveLoops,
        world: World,
        physics: RigDriveSection,
        clock: Callable[[], float],
        on_held: Callable[[], None],
    ) -> None:
        self._joint, self._loop, self._world = joint, loop, world
        self._sag_s, self._release_s = physics.torque_delay_s, physics.brake_delay_s
        self._clock, self._on_held = clock, on_held
        self._follows_at_s = self._lets_go_at_s = NEVER

    @property
    def due_s(self) -> float:
        """Physics time at which `tick` has something to do next [s]."""
        return min(self._follows_at_s, self._lets_go_at_s)

    @property
    def coming_on(self) -> bool:
        """True from `switch_on` until the brake is open and the drive follows."""
        return self._follows_at_s < NEVER

    def switch_on(self) -> None:
        """Begin to hold the joint and to open the brake."""
        self._let_go()
        sags = self._sag_s > 0.0
        if sags:
            self._world.set_brake(self._joint, closed=False)
        else:
            self._hold()
        self._follows_at_s = self._clock() + (self._sag_s if sags else self._release_s)

    def switch_off(self, *, at_once: bool = False) -> None:
        """Close the brake, and hold the joint until it has closed; not if the power is lost."""
        self._follows_at_s = NEVER
        self._world.set_brake(self._joint, closed=True)
        delay_s = self._world.brakes.delay_s(self._joint)
        if at_once or delay_s <= 0.0:
            self._let_go()
        elif self._lets_go_at_s == NEVER:
            self._lets_go_at_s = self._clock() + delay_s

    def tick(self, now: float) -> bool:
        """Do what is due; return whether the drive follows from now on."""
        if now >= self._lets_go_at_s:
            self._let_go()
        if now < self._follows_at_s:
            return False
        self._follows_at_s = NEVER
        if self._sag_s > 0.0:
            self._hold()
        else:
            self._world.set_brake(self._joint, closed=False)
            self._on_held()
        return True

    def ramp_down(self, deceleration: float, *, from_torque: bool) -> None:
        """Bring the joint to rest by the drive's own loop [rad/s²]; `from_torque`: out of CST."""
        joint, world = self._joint, self._world
        if from_torque:
            self._loop.take_over(joint, float(world.q[joint]), float(world.dq[joint]))
        self._loop.ramp_down(joint, deceleration)

    def give_up_error(self) -> None:
        """Put the reference where the joint is: no following error is left."""
        joint, world = self._joint, self._world
        self._loop.resume_from(joint, float(world.q[joint]), float(world.dq[joint]))

    def _hold(self) -> None:
        self._loop.engage(self._joint, float(self._world.q[self._joint]))
        self._on_held()

    def _let_go(self) -> None:
        self._lets_go_at_s = NEVER
        self._loop.release(self._joint)


# --- The simulated CiA 402 servo drive in CSP, CSV and CST, with a holding brake ------------------
#
# What it does beside the profile, as real drives do: it holds the joint before it opens the
# brake, in CST with the torque that it is sent, and follows once the brake is open
# (`servo.py`); a quick stop and a fault's ramp are run by the drive's own loops, whatever
# the mode, from the torque that it gives; the mode is not changed while the power is on; the
# setpoint timeout 2F00h (see the device's EDS); a fault is reset only when its cause has gone.
# A setpoint acts at the SYNC after it was written, by PDO or SDO; one that was written before
# the drive was enabled does not.

_AT_ONCE, _RAMP, _RAMP_AND_STAY = 0, 2, 6
"""605Ah: takes the power at once; ramps on 6085h and then does; ramps and then holds."""
_ENABLED = DriveState.OPERATION_ENABLED
_MOVING = (_ENABLED, DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION_ACTIVE)
_ALWAYS: Final = Status.VOLTAGE_ENABLED | Status.REMOTE
_NO_MODE = 0
_MODES = (OperationMode.CSP, OperationMode.CSV, OperationMode.CST)
_TARGETS = frozenset(
    (index, 0)
    for index in (
        Object.TARGET_POSITION,
        Object.TARGET_VELOCITY,
        Object.VELOCITY_OFFSET,
        Object.TARGET_TORQUE,
    )
)
_TUNING = frozenset(
    (
        Object.FOLLOWING_WINDOW,
        Object.MODE_OF_OPERATION,
        Object.TORQUE_OFFSET,
        Object.MAX_TORQUE,
        Object.POSITION_LIMIT,
        Object.INTERPOLATION_PERIOD,
    )
)


class SimulatedDrive(CanNode):
    """One joint's drive. `joint` is its place in `loop` and `world`; `clock` gives physics time."""

    plain = _TARGETS | {_CONTROLWORD}

    def __init__(
        self,
        drive: DriveSection,
        joint: int,
        link: NodeLink,
        loop: DriveLoops,
        world: World,
        physics: RigDriveSection,
        clock: Callable[[], float],
    ) -> None:
        super().__init__(drive.node, link, clock)
        self.drive = drive
        self.state = DriveState.NOT_READY
        self._joint, self._loop, self._world = joint, loop, world
        self._power = PowerStage(joint, loop, world, physics, clock, self._follow_torque)
        self._broken = False
        self._controlword = 0
        self._error = EmcyCode.NO_ERROR
        self._setpoint_s = 0.0
        self._asked = False
        self._cut = False
        self._measured = Measured(drive, joint, loop, world)
        self.objects.measured |= {**self._measured.objects, _STATUSWORD: self._statusword}
        choices = self.objects.choices
        choices[Object.MODE_OF_OPERATION, 0] = frozenset((_NO_MODE, *_MODES))
        choices[Object.QUICK_STOP_OPTION, 0] = frozenset((_AT_ONCE, _RAMP, _RAMP_AND_STAY))

    def break_down(self, broken: bool) -> None:
        """Let the power stage fail (EMCY 2310h), or take the cause of that failure away."""
        self._broken = broken
        if broken:
            self._fail(EmcyCode.OVERCURRENT, ramp=False)

    @classmethod
    def from_bench(cls, entry: Entry, bench: Bench) -> Self:
        """Make the drive of one of the bench's joints."""
        drive, physics = cast(DriveSection, entry.section), bench.rig(entry).drive
        joint, link = bench.joint(entry), bench.link()
        return cls(drive, joint, link, bench.loop, bench.world, physics, bench.clock)

    def inject(self, fault: RigFault) -> None:
        """Break the drive or send an emergency message; other faults are the joint's."""
        if fault.kind == "fault":
            self.break_down(fault.on)
        elif fault.kind != "emcy":
            inject_at_joint(fault, self._world, self._joint, self.drive)
        elif fault.on:
            code = value_of(fault, 0, 0xFFFF, "", default=EmcyCode.OVERTEMPERATURE)
            self.emergency(round(code))

    def _statusword(self) -> int:
        word = _ALWAYS | cia402.STATE_BITS[self.state]
        if self.state is _ENABLED:
            word |= Status.FOLLOWS_COMMAND
            if self._measured.reached:
                word |= Status.TARGET_REACHED
        if self._cut:
            word |= Status.INTERNAL_LIMIT
        if self._error is EmcyCode.FOLLOWING_ERROR:
            word |= Status.FOLLOWING_ERROR
        return word

    def on_reset(self, *, communication_only: bool) -> None:
        """Take the power off; a fault outlives a reset of the communication only."""
        self._power.switch_off()
        if not communication_only:
            self.objects[Object.MAX_TORQUE, 0] = most_torque(self.drive)
        self._tune()
        self._controlword, self._cut, self._asked = 0, False, False
        if not (communication_only and self.state.in_fault):
            self.state, self._error = DriveState.SWITCH_ON_DISABLED, EmcyCode.NO_ERROR
        else:
            self.state = DriveState.FAULT
        if self._broken and not self.state.in_fault:
            self._fail(EmcyCode.OVERCURRENT, ramp=False)

    def on_written(self, index: int, subindex: int, value: int) -> None:
        """React to objects that act when they are written."""
        if index == Object.MODE_OF_OPERATION:
            self._select(value)
        elif index == Object.MAX_TORQUE and value > most_torque(self.drive):
            raise RefusedError(Abort.INVALID_VALUE)
        self.objects[index, subindex] = value
        if index == Object.CONTROLWORD:
            self._obey(value)
        elif index in _TUNING:
            self._tune()
        elif (index, subindex) in _TARGETS:
            self._asked = True

    def on_setpoint_frame(self) -> None:
        """Restart the watch for setpoints."""
        self._setpoint_s = self.clock()

    def on_rpdo(self, pdo: Pdo) -> None:
        """Obey the controlword, then follow the setpoint of the mode, of a PDO that has them."""
        if _CONTROLWORD in pdo.keys:
            word = self.objects.image[_CONTROLWORD]
            # The word by which it was enabled asks for nothing more.
            if word != self._controlword or self.state is not _ENABLED:
                self._obey(word)
        if self.state is _ENABLED and not _TARGETS.isdisjoint(pdo.keys):
            self._follow()

    def on_sync(self) -> None:
        """Follow a setpoint that came by SDO."""
        if self._asked:
            self._asked = False
            if self.state is _ENABLED:
                self._follow(streamed=False)

    def on_master_lost(self) -> None:
        """Do what 6007h says."""
        option = self.objects[Object.ABORT_CONNECTION_OPTION, 0]
        if option == AbortConnectionOption.FAULT:
            self._fail(EmcyCode.HEARTBEAT, ramp=True, tell=False)
        elif self.state in (_ENABLED, DriveState.SWITCHED_ON):
            if option == AbortConnectionOption.QUICK_STOP and self.state is _ENABLED:
                self._quick_stop()
            elif option != AbortConnectionOption.NOTHING:
                self._disable(DriveState.SWITCH_ON_DISABLED)

    def on_master_back(self) -> None:
        """Tell that the error has gone, unless it has become a fault."""
        if not self.state.in_fault:
            self.emergency(EmcyCode.NO_ERROR)

    def tick(self) -> None:
        """Do what is due: brake and torque, ends of ramps, watches."""
        super().tick()
        now = self.clock() + 1e-7
        if self._power.tick(now):
            self._setpoint_s = self.clock()
            self.state = _ENABLED
        if self._loop.steps_beyond[self._joint]:
            self._watch_following()
        if self.state is _ENABLED:
            timeout = self.objects.image[_SETPOINT_TIMEOUT] * 1e-3
            if timeout > 0:
                if now > self._setpoint_s + timeout:
                    self._fail(EmcyCode.SETPOINT_TIMEOUT, ramp=True)
                self.due_s = min(self.due_s, self._setpoint_s + timeout)
        if self.state in (DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION_ACTIVE):
            self._end_of_ramp()
            self.due_s = 0.0
        self.due_s = min(self.due_s, self._power.due_s)

    def _obey(self, word: int) -> None:
        self.due_s = 0.0
        before, previous = self.state, self._controlword
        self._controlword = word
        wanted = cia402.apply_controlword(before, previous, word)
        if self._power.coming_on:
            if wanted is _ENABLED:
                return
            self._power.switch_off()
        if wanted is before:
            return
        if before is DriveState.FAULT:
            self._reset_fault()
        elif wanted is _ENABLED:
            self._enable()
        elif wanted is DriveState.QUICK_STOP_ACTIVE:
            self._quick_stop()
        else:
            self._disable(wanted)

    def _enable(self) -> None:
        if self._mode in _MODES:
            self._power.switch_on()

    def _disable(self, state: DriveState, *, at_once: bool = False) -> None:
        self._power.switch_off(at_once=at_once)
        self.due_s = min(self.due_s, self._power.due_s)
        self.state = state

    def _quick_stop(self) -> None:
        if self.objects[Object.QUICK_STOP_OPTION, 0] == _AT_ONCE:
            self._disable(DriveState.SWITCH_ON_DISABLED, at_once=True)
            return
        self.state = DriveState.QUICK_STOP_ACTIVE
        self._ramp_down()

    def _end_of_ramp(self) -> None:
        if not self._loop.at_rest(self._joint):
            return
        if self.state is DriveState.FAULT_REACTION_ACTIVE:
            self._disable(DriveState.FAULT)
        elif self.objects[Object.QUICK_STOP_OPTION, 0] != _RAMP_AND_STAY:
            self._disable(DriveState.SWITCH_ON_DISABLED)

    def _fail(self, error: EmcyCode, *, ramp: bool, tell: bool = True) -> None:
        if self.state is DriveState.FAULT:
            return
        self._error = error
        if tell:
            self.emergency(error)
        if ramp and self.state in _MOVING:
            self.state = DriveState.FAULT_REACTION_ACTIVE
            self._ramp_down()
        else:
            self._disable(DriveState.FAULT, at_once=True)

    def _reset_fault(self) -> None:
        if self._broken or (self._error is EmcyCode.HEARTBEAT and self.master_lost):
            return
        self.state, self._error = DriveState.SWITCH_ON_DISABLED, EmcyCode.NO_ERROR
        self.emergency(EmcyCode.NO_ERROR)

    @property
    def _mode(self) -> int:
        return self.objects.image[_MODE_DISPLAY]

    def _select(self, mode: int) -> None:
        if mode != self._mode and (self.state is _ENABLED or self._power.coming_on):
            raise RefusedError(Abort.WRONG_STATE)
        self.objects[Object.MODE_DISPLAY, 0] = mode

    def _follow(self, *, streamed: bool = True) -> None:
        """Follow the newest setpoint of the mode; what the drive's limits cut is reported."""
        at = (self._interpolation, self._loop, self._joint, self.drive)
        mode = self.objects.image[_MODE_DISPLAY]
        self._cut = follow(mode, self.objects, *at, streamed=streamed)

    def _tune(self) -> None:
        at = (self._loop, self._joint, self.drive)
        self._interpolation = tune(self._mode, self.objects, *at)

    def _follow_torque(self) -> None:
        if self._mode == OperationMode.CST:
            self._follow()

    def _ramp_down(self) -> None:
        ramp, in_torque = deceleration(self.objects, self.drive), self._mode == OperationMode.CST
        self._power.ramp_down(ramp, from_torque=in_torque)

    def _watch_following(self) -> None:
        elapsed = self._loop.steps_beyond[self._joint] * self._loop.dt
        if elapsed * 1000 <= self.objects[Object.FOLLOWING_TIMEOUT, 0] or self.state.in_fault:
            return
        self._power.give_up_error()
        self._fail(EmcyCode.FOLLOWING_ERROR, ramp=True)
