"""The simulated CiA 402 servo drive in CSP, CSV and CST, with a holding brake.

What it does beside the profile, as real drives do: it holds the joint before it opens the brake, in
CST with the torque that it is sent, and follows once the brake is open (`power_stage.py`); a quick
stop and a fault's ramp are run by the drive's own loops, whatever the mode, from the torque that it
gives; the mode is not changed while the power is on; the setpoint timeout 2F00h (see the device's
EDS); a fault is reset only when its cause has gone. A setpoint acts at the SYNC after it was
written, by PDO or SDO; one that was written before the drive was enabled does not.
"""

from collections.abc import Callable
from typing import Self, cast

from .....config.schema.bus.on_bus import Entry
from .....config.schema.mechanism.mechanism import DriveSection
from .....config.schema.rig.rig import RigDriveSection
from .....protocols.canopen import cia402
from .....protocols.canopen.can301 import EmcyCode
from .....protocols.canopen.cia402 import (
    AbortConnectionOption,
    DriveState,
    Object,
    OperationMode,
    Status,
)
from .....protocols.canopen.sdo import Abort
from .....protocols.messages.rig import RigFault
from ...fault_values import value_of
from ...physics.world import World
from ..bench import Bench
from ..canopen.can_node import CanNode
from ..canopen.objects import RefusedError
from ..canopen.pdo import Pdo
from ..drive_loops import DriveLoops
from ..link import NodeLink
from .drive_setpoint import deceleration, follow, most_torque, tune
from .joint_faults import inject_at_joint
from .measured import Measured
from .power_stage import PowerStage

_AT_ONCE, _RAMP, _RAMP_AND_STAY = 0, 2, 6
"""605Ah: takes the power at once; ramps on 6085h and then does; ramps and then holds."""
_ENABLED = DriveState.OPERATION_ENABLED
_MOVING = (_ENABLED, DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION_ACTIVE)
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
    (Object.FOLLOWING_WINDOW, Object.MODE_OF_OPERATION, Object.TORQUE_OFFSET, Object.MAX_TORQUE)
)


class SimulatedDrive(CanNode):
    """One joint's drive. `joint` is its place in `loop` and `world`; `clock` gives physics time."""

    plain = _TARGETS | {(Object.CONTROLWORD, 0)}

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
        self.objects.live[Object.STATUSWORD, 0] = self.statusword
        self.objects.live.update(self._measured.objects())
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

    def statusword(self) -> int:
        """Return 6041h."""
        word: int = cia402.STATE_BITS[self.state] | Status.VOLTAGE_ENABLED | Status.REMOTE
        if self.state is _ENABLED:
            word |= Status.FOLLOWS_COMMAND
            if self._measured.target_reached:
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
        tune(self._mode, self.objects, self._loop, self._joint, self.drive)
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
            tune(self._mode, self.objects, self._loop, self._joint, self.drive)
        elif (index, subindex) in _TARGETS:
            self._asked = True

    def on_setpoint_frame(self) -> None:
        """Restart the watch for setpoints."""
        self._setpoint_s = self.clock()

    def on_rpdo(self, pdo: Pdo) -> None:
        """Obey the controlword, then follow the setpoint of the mode, of a PDO that has them."""
        if (Object.CONTROLWORD, 0) in pdo.keys:
            self._obey(self.objects[Object.CONTROLWORD, 0])
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
            timeout = self.objects[Object.SETPOINT_TIMEOUT, 0] * 1e-3
            if timeout > 0:
                if now > self._setpoint_s + timeout:
                    self._fail(EmcyCode.SETPOINT_TIMEOUT, ramp=True)
                self.due_s = min(self.due_s, self._setpoint_s + timeout)
        if self.state in (DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION_ACTIVE):
            self._end_of_ramp()
            self.due_s = 0.0
        self.due_s = min(self.due_s, self._power.due_s)

    def _obey(self, word: int) -> None:
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
        return self.objects[Object.MODE_DISPLAY, 0]

    def _select(self, mode: int) -> None:
        if mode != self._mode and (self.state is _ENABLED or self._power.coming_on):
            raise RefusedError(Abort.WRONG_STATE)
        self.objects[Object.MODE_DISPLAY, 0] = mode

    def _follow(self, *, streamed: bool = True) -> None:
        """Follow the newest setpoint of the mode; what the drive's limits cut is reported."""
        at = (self._loop, self._joint, self.drive)
        self._cut = follow(self._mode, self.objects, *at, streamed=streamed)

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
