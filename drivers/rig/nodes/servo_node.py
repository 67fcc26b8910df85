"""The simulated CiA 402 servo drive in CSP, CSV and CST, with a holding brake.

What it does beside the profile, as real drives do: it holds the joint before it opens the brake, in
CST with the torque that it is sent, and follows once the brake is open (one that is set wrongly
opens the brake first, and the joint sags); a quick stop and a fault's ramp are run by the drive's
own loops, whatever the mode, from the torque that it gives; the mode is not changed while the power
is on; the setpoint timeout 2F00h (see the
device's EDS); a fault is reset only when its cause has gone.
"""

from collections.abc import Callable
from typing import Self, cast

from ....config.schema.mechanism import Drive
from ....config.schema.on_bus import Entry
from ....config.schema.rig.rig import RigDrive
from ....protocols.canopen import cia402
from ....protocols.canopen.can301 import EmcyCode, NmtState
from ....protocols.canopen.cia402 import (
    AbortConnectionOption,
    DriveState,
    Object,
    OperationMode,
    Status,
)
from ....protocols.canopen.counter import wrapped
from ....protocols.messages.rig import RigFault
from ..fault_values import value_of
from ..physics.world import World
from .bench import Bench
from .can_node import NEVER, CanNode
from .drive_loops import DriveLoops
from .drive_setpoint import deceleration, follow, tune
from .joint_faults import inject_at_joint
from .link import NodeLink
from .objects import WrongStateError
from .pdo import Pdo

_AT_ONCE = 0
_STAYS = frozenset((5, 6))
"""605Ah: 0 takes the power at once, 1 and 2 ramp and then do, 5 and 6 ramp and then hold."""
_ENABLED = DriveState.OPERATION_ENABLED
_I16 = 2**15 - 1
_TARGET_REACHED_RAD = 1e-3
_MODES = (OperationMode.CSP, OperationMode.CSV, OperationMode.CST)


class SimulatedDrive(CanNode):
    """One joint's drive. `joint` is its place in `loop` and `world`; `clock` gives physics time."""

    def __init__(
        self,
        drive: Drive,
        joint: int,
        link: NodeLink,
        loop: DriveLoops,
        world: World,
        physics: RigDrive,
        clock: Callable[[], float],
    ) -> None:
        super().__init__(drive.node, link, clock)
        self.drive = drive
        self.state = DriveState.NOT_READY
        self._joint = joint
        self._loop = loop
        self._world = world
        self._sag_s, self._release_s = physics.torque_delay_s, physics.brake_delay_s
        self._scale = drive.direction * drive.counts_per_radian
        self._broken = False
        self._controlword = 0
        self._error = EmcyCode.NO_ERROR
        self._follows_at_s = self._lets_go_at_s = NEVER
        self._setpoint_s = 0.0
        self._cut = False
        live = self.objects.live
        live[Object.STATUSWORD, 0] = self.statusword
        live[Object.POSITION_ACTUAL, 0] = lambda: self._to_counts(world.angle(joint))
        live[Object.VELOCITY_ACTUAL, 0] = lambda: round(self._scale * world.dq[joint])
        live[Object.TORQUE_ACTUAL, 0] = self._torque
        live[Object.RATED_TORQUE, 0] = lambda: round(drive.rated_torque * 1000)
        live[Object.MAX_TORQUE, 0] = lambda: round(drive.max_torque / drive.rated_torque * 1000)

    def break_down(self, broken: bool) -> None:
        """Let the power stage fail (EMCY 2310h), or take the cause of that failure away."""
        self._broken = broken
        if broken:
            self._fail(EmcyCode.OVERCURRENT, ramp=False)

    @classmethod
    def from_bench(cls, entry: Entry, bench: Bench) -> Self:
        """Make the drive of one of the bench's joints."""
        drive, physics = cast(Drive, entry.section), bench.rig(entry).drive
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

    def statusword(self) -> int:
        """Return 6041h."""
        joint, loop = self._joint, self._loop
        word: int = cia402.STATE_BITS[self.state] | Status.VOLTAGE_ENABLED
        if self.nmt is NmtState.OPERATIONAL:
            word |= Status.REMOTE
        if self.state is _ENABLED:
            word |= Status.FOLLOWS_COMMAND
            if abs(loop.error[joint]) < _TARGET_REACHED_RAD and loop.at_rest(joint):
                word |= Status.TARGET_REACHED
        if self._cut:
            word |= Status.INTERNAL_LIMIT
        if loop.steps_beyond[joint] > 0 or self._error is EmcyCode.FOLLOWING_ERROR:
            word |= Status.FOLLOWING_ERROR
        return word

    def _torque(self) -> int:
        torque = float(self._loop.reported[self._joint])
        share = torque / self.drive.rated_torque * self.drive.direction
        return max(-_I16, min(_I16, round(share * 1000)))

    def _to_counts(self, angle: float) -> int:
        return wrapped(round(self._scale * (angle - self.drive.zero_rad)))

    def on_reset(self, *, communication_only: bool) -> None:
        """Take the power off; a fault outlives a reset of the communication only."""
        self._power_off()
        tune(self._mode, self.objects, self._loop, self._joint, self.drive)
        self._controlword, self._cut = 0, False
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
        self.objects[index, subindex] = value
        if index == Object.CONTROLWORD:
            self._obey(value)
        elif index in (Object.FOLLOWING_WINDOW, Object.MODE_OF_OPERATION, Object.TORQUE_OFFSET):
            tune(self._mode, self.objects, self._loop, self._joint, self.drive)

    def on_setpoint_frame(self) -> None:
        """Restart the watch for setpoints."""
        self._setpoint_s = self.clock()

    def on_rpdo(self, _pdo: Pdo) -> None:
        """Obey the controlword, then follow the setpoint of the mode, of a PDO that has them."""
        if (Object.CONTROLWORD, 0) not in _pdo.keys:
            return
        self._obey(self.objects[Object.CONTROLWORD, 0])
        if self.state is _ENABLED:
            self._follow()

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
        if now >= self._lets_go_at_s:
            self._let_go()
        if now >= self._follows_at_s:
            self._begin()
        if self._loop.steps_beyond[self._joint]:
            self._watch_following()
        if self.state is _ENABLED:
            timeout = self.objects[Object.SETPOINT_TIMEOUT, 0] * 1e-3
            if timeout > 0:
                if now > self._setpoint_s + timeout:
                    self._fail(EmcyCode.SETPOINT_TIMEOUT, ramp=True)
                self.due_s = min(self.due_s, self._setpoint_s + timeout)
        if self.state in (DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION_ACTIVE):
            self._end_of_ramp()
            self.due_s = 0.0
        self.due_s = min(self.due_s, self._follows_at_s, self._lets_go_at_s)

    def _obey(self, word: int) -> None:
        before, previous = self.state, self._controlword
        self._controlword = word
        wanted = cia402.apply_controlword(before, previous, word)
        if self._follows_at_s < NEVER:
            if wanted is _ENABLED:
                return
            self._power_off()
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
        if self._mode not in _MODES:
            return
        self._let_go()
        sags = self._sag_s > 0.0
        if sags:
            self._world.set_brake(self._joint, closed=False)
        else:
            self._hold()
        self._follows_at_s = self.clock() + (self._sag_s if sags else self._release_s)

    def _hold(self) -> None:
        self._loop.engage(self._joint, float(self._world.q[self._joint]))
        if self._mode == OperationMode.CST:
            self._follow()

    def _begin(self) -> None:
        self._follows_at_s = NEVER
        if self._sag_s > 0.0:
            self._hold()
        else:
            self._world.set_brake(self._joint, closed=False)
            if self._mode == OperationMode.CST:
                self._follow()
        self._setpoint_s = self.clock()
        self.state = _ENABLED

    def _disable(self, state: DriveState, *, at_once: bool = False) -> None:
        self._power_off(at_once=at_once)
        self.state = state

    def _power_off(self, *, at_once: bool = False) -> None:
        """Close the brake, and hold the joint until it has closed; not if the power is lost."""
        self._follows_at_s = NEVER
        self._world.set_brake(self._joint, closed=True)
        delay_s = self._world.brakes.delay_s(self._joint)
        if at_once or delay_s <= 0.0:
            self._let_go()
        elif self._lets_go_at_s == NEVER:
            self._lets_go_at_s = self.clock() + delay_s
            self.due_s = min(self.due_s, self._lets_go_at_s)

    def _let_go(self) -> None:
        self._lets_go_at_s = NEVER
        self._loop.release(self._joint)

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
        elif self.objects[Object.QUICK_STOP_OPTION, 0] not in _STAYS:
            self._disable(DriveState.SWITCH_ON_DISABLED)

    def _fail(self, error: EmcyCode, *, ramp: bool, tell: bool = True) -> None:
        if self.state is DriveState.FAULT:
            return
        self._error = error
        if tell:
            self.emergency(error)
        moving = self.state in (
            _ENABLED,
            DriveState.QUICK_STOP_ACTIVE,
            DriveState.FAULT_REACTION_ACTIVE,
        )
        if ramp and moving:
            self.state = DriveState.FAULT_REACTION_ACTIVE
            self._ramp_down()
        else:
            self._disable(DriveState.FAULT, at_once=True)

    def _reset_fault(self) -> None:
        still = (self._error is EmcyCode.HEARTBEAT and self.master_lost) or self._broken
        if still:
            return
        self.state, self._error = DriveState.SWITCH_ON_DISABLED, EmcyCode.NO_ERROR
        self.emergency(EmcyCode.NO_ERROR)

    @property
    def _mode(self) -> int:
        return self.objects[Object.MODE_DISPLAY, 0]

    def _select(self, mode: int) -> None:
        if mode != self._mode and (self.state is _ENABLED or self._follows_at_s < NEVER):
            raise WrongStateError
        self.objects[Object.MODE_DISPLAY, 0] = mode if mode in _MODES else 0

    def _follow(self) -> None:
        """Follow the newest setpoint of the mode; what the drive's limits cut is reported."""
        self._cut = follow(self._mode, self.objects, self._loop, self._joint, self.drive)

    def _ramp_down(self) -> None:
        joint, world = self._joint, self._world
        if self._mode == OperationMode.CST:
            self._loop.take_over(joint, float(world.q[joint]), float(world.dq[joint]))
        self._loop.ramp_down(joint, deceleration(self.objects, self.drive))

    def _watch_following(self) -> None:
        elapsed = self._loop.steps_beyond[self._joint] * self._loop.dt
        if elapsed * 1000 <= self.objects[Object.FOLLOWING_TIMEOUT, 0] or self.state.in_fault:
            return
        joint, world = self._joint, self._world
        self._loop.resume_from(joint, float(world.q[joint]), float(world.dq[joint]))
        self._fail(EmcyCode.FOLLOWING_ERROR, ramp=True)
