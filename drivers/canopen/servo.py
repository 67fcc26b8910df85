"""A CiA 402 servo drive in a cyclic synchronous mode, as one joint."""

import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

import can
import canopen
from canopen.emcy import EmcyError
from canopen.sdo.exceptions import SdoError

from ...config.schema.cell import TimingSection
from ...config.schema.mechanism import DriveSection
from ...protocols.canopen import can301, cia402
from ...protocols.canopen.can301 import CommunicationObject as Com
from ...protocols.canopen.can301 import EmcyCode, FrameError, NmtState
from ...protocols.canopen.cia402 import Controlword, DriveState, Object, OperationMode, Unwrapped
from ..device import (
    MOST_MISSED_SYNCS,
    OBEYED_SYNCS,
    RESET_SYNCS,
    SWITCH_OFF_S,
    Cause,
    DeviceError,
    JointDrive,
    Sent,
    ServoReading,
    Trouble,
    wrong_emergency,
    wrong_status,
)
from ..fieldbus import Fieldbus
from . import servo_setup
from .servo_setup import U8, U32, Setpoint, SetupWrite

# --- Next controlword (6040h) of a servo drive, by its state and by what is wanted of it ----------


def next_word(
    state: DriveState | None,
    target: DriveState,
    *,
    stopped: bool,
    overdue: bool,
    reset: bool | None,
) -> int:
    """Return the controlword on the way from `state` (None: not known) to `target`.

    A drive that is `stopped` gets a quick stop. `reset` of a fault: None without one, False while
    bit 7 is still low, True for its rising edge. A quick stop that stays (605Ah of 5 to 8) ends
    once switching off is `overdue`.
    """
    if stopped:
        return Controlword.QUICK_STOP
    if state is None:
        return Controlword.DISABLE_VOLTAGE
    if reset is not None and state.in_fault:
        return Controlword.FAULT_RESET if reset else Controlword.DISABLE_VOLTAGE
    if state is DriveState.QUICK_STOP_ACTIVE and overdue:
        return Controlword.DISABLE_VOLTAGE
    return cia402.next_controlword(state, target)


# --- Where a drive's joint is, by its counter of 32 bits: that of a wheel wraps -------------------


class JointPosition:
    """Position of one drive's joint; an `endless` one, a wheel, has no limits."""

    def __init__(self, drive: DriveSection, endless: bool) -> None:
        self._drive, self._endless = drive, endless
        self._turns = Unwrapped()
        self._counts = 0

    def limits(self, lower: float, upper: float) -> tuple[float, float]:
        """Return the range of 607Dh for a joint with these limits [rad]."""
        return servo_setup.whole_range(self._drive) if self._endless else (lower, upper)

    def take(self, counts: int) -> None:
        """Take in a reading of 6064h."""
        self._counts = self._turns.take(counts) if self._endless else counts

    @property
    def rad(self) -> float:
        """The joint's angle [rad]."""
        return servo_setup.to_radians(self._drive, self._counts)

    @property
    def in_range(self) -> float:
        """The angle for which 607Dh needs room [rad]; wherever a wheel stands, it has enough."""
        return self._drive.zero_rad if self._endless else self.rad


# --- Objects of a servo drive that depend on where its joint stands: room (607Dh), torque (60B2h)
#
# Written over SDO with the drive's power off, where they change.


class Standstill:
    """Range and preload of one drive; `lower`, `upper` are the joint's limits [rad]."""

    def __init__(
        self,
        node: canopen.RemoteNode,
        drive: DriveSection,
        mode: OperationMode,
        lower: float,
        upper: float,
    ) -> None:
        self._node, self._drive = node, drive
        # In CST the setpoint itself is the torque.
        self._preloads = mode is not OperationMode.CST
        self._torque = Setpoint(drive, OperationMode.CST)
        self._limits = lower, upper
        self.configured()

    def configured(self) -> None:
        """Take note that `servo_setup.configure` has written all objects."""
        self._room, self._offset = self._limits, 0

    def write(self, q: float, torque: float) -> bool:
        """Prepare for a joint at `q` [rad] that `torque` holds [N·m]; return whether any changed.

        Blocks where an object has to change; raises `DeviceError`. A drive without 60B2h has its
        integral take the torque, after the joint has sagged a little.
        """
        room = servo_setup.room(self._drive, *self._limits, q)
        most = self._drive.max_torque
        held = min(max(torque, -most), most) if self._preloads else 0.0
        offset = self._torque.raw(held)
        changed = (room, offset) != (self._room, self._offset)
        if room != self._room:
            servo_setup.write_limits(self._node, self._drive, *room)
        if offset != self._offset:
            servo_setup.write_torque_offset(self._node, self._drive, offset)
        self._room, self._offset = room, offset
        return changed


# --- RPDO2 with 6085h: a drive is told the ramp of the quick stop that follows --------------------
#
# It is mapped once, in *Pre-operational*, and sent just before a quick stop only; the drive
# takes it over when it comes, without a SYNC. A reset configures the drive anew, with the
# cell's own ramp.

_NUMBER: Final = 1
"""RPDO2, counted from 0."""
_LAYOUT: Final = struct.Struct("<I")


class StopRamp:
    """Tells one drive the ramp of its quick stop."""

    def __init__(self, fieldbus: Fieldbus, node: canopen.RemoteNode, drive: DriveSection) -> None:
        self._bus, self._node, self._drive = fieldbus, node, drive
        self._id = can301.rpdo1_id(drive.node) + 0x100 * _NUMBER

    def map(self) -> None:
        """Map 6085h in *Pre-operational*, after the drive was configured. Raises `DeviceError`."""
        try:
            for step in self._steps():
                servo_setup.write(self._node, self._drive, step)
        except DeviceError as error:
            raise DeviceError(
                f"{error}; the drive takes no 6085h by PDO: set quick_stop = 'each' in the task "
                "that holds a payload with others, or in the arm's backbone"
            ) from error

    def send(self, deceleration: float) -> None:
        """Send the ramp of the next quick stop [rad/s²]."""
        counts = round(deceleration * self._drive.counts_per_radian)
        self._bus.send(self._id, _LAYOUT.pack(min(max(counts, 1), 2**32 - 1)))

    def _steps(self) -> Iterator[SetupWrite]:
        communication = Com.RPDO_COMMUNICATION + _NUMBER
        mapping = Com.RPDO_MAPPING + _NUMBER
        yield SetupWrite(communication, 2, U8, can301.AT_ONCE)
        yield SetupWrite(mapping, 0, U8, 0)
        yield SetupWrite(
            mapping, 1, U32, can301.mapping_entry(Object.QUICK_STOP_DECELERATION, 0, 32)
        )
        yield SetupWrite(mapping, 0, U8, 1)
        yield SetupWrite(communication, 1, U32, self._id)


# --- A CiA 402 servo drive in a cyclic synchronous mode, as one joint -----------------------------

BOOT_TIMEOUT_S: Final = 2.0
_ENABLED: Final = DriveState.OPERATION_ENABLED
_DISABLED: Final = DriveState.SWITCH_ON_DISABLED


class ServoDrive(JointDrive):
    """One joint's drive; keeps the contract of `device.py`.

    `lower` and `upper` are the joint's limits [rad] (607Dh); `mode` says what a setpoint is: rad in
    CSP, rad/s in CSV, N·m in CST; `eds` names the drive's objects. A wheel is `endless`.
    `read` judges by what `Fieldbus.receive` dispatched and by its `now`. The first trouble stays
    until `request_fault_reset` finds its cause gone; a node that restarted has lost its
    configuration and needs `open` again.
    """

    def __init__(
        self,
        fieldbus: Fieldbus,
        drive: DriveSection,
        timing: TimingSection,
        *,
        lower: float,
        upper: float,
        mode: OperationMode = OperationMode.CSP,
        eds: Path | None = None,
        endless: bool = False,
    ) -> None:
        self.drive, self.name = drive, drive.joint
        self._mode = mode
        self._setpoint = Setpoint(drive, mode)
        self._bus, self.bus = fieldbus, fieldbus.name
        self._timing = timing
        self._position = JointPosition(drive, endless)
        self._limits = lower, upper = self._position.limits(lower, upper)
        self.answer_stamp = 0.0
        """The bus' stamp of the newest TPDO1, which a SYNC asked for [s], on the bus' own clock."""
        self.node = fieldbus.add_node(drive.node, eds)
        self._standstill = Standstill(self.node, drive, mode, lower, upper)
        self.node.nmt.add_heartbeat_callback(self._on_heartbeat)
        self.node.emcy.add_callback(self._on_emcy)
        self._tpdo_id = can301.tpdo1_id(drive.node)
        fieldbus.listen(self._tpdo_id, self._on_feedback)
        self._rpdo_id = can301.rpdo1_id(drive.node)
        self.ramp: StopRamp | None = None
        """Tells the drive the ramp of a quick stop, set before it is opened; None: its own."""
        self._booted = self._opened = False
        self._forget()

    def _forget(self) -> None:
        self._feedback: cia402.Feedback | None = None
        self._state: DriveState | None = None
        self._answered_sync = self._told_sync = self._bus.sync_count
        self._sampled_s: float | None = None
        self._heartbeat_s: float | None = None
        self._was_operational = self._seen_enabled = self._stopped = False
        self._restarted: int | None = None
        self._emcy: EmcyError | None = None
        self._target = _DISABLED
        self._reset_sync: int | None = None
        self._trouble: Trouble | None = None

    def open(self) -> None:
        """Reset the node's communication, configure it and start it. Blocks; `DeviceError`."""
        self._booted = self._opened = False
        self._bus.expect_no_answers(self._tpdo_id)
        try:
            self.node.nmt.send_command(can301.NmtCommand.RESET_COMMUNICATION)
            if not self._bus.wait_until(lambda: self._booted, BOOT_TIMEOUT_S):
                missing = f"no boot-up message within {BOOT_TIMEOUT_S} s of a reset"
                raise DeviceError(f"{self.name} (node {self.drive.node}): {missing}")
            servo_setup.configure(
                self.node, self.drive, self._timing, *self._limits, self._mode, self._bus.pause
            )
            if self.ramp is not None:
                self.ramp.map()
            self._standstill.configured()
            self._bus.expect_answers(self._tpdo_id)
            self.node.nmt.send_command(can301.NmtCommand.START)
        except can.CanError as error:
            raise DeviceError(f"{self.name} (node {self.drive.node}): {error}") from error
        self._forget()
        self._opened = True

    @property
    def answered(self) -> bool:
        """True once the drive has answered the newest SYNC."""
        return self._feedback is not None and self._answered_sync == self._bus.sync_count

    @property
    def emergency(self) -> Trouble | None:
        """Trouble that a message of its own told of: it comes before the next answer to a SYNC.

        That is an emergency message, or a heartbeat by which the node has left Operational.
        """
        if self._restarted is not None:
            detail = "the node left Operational: its configuration is lost"
            return self._wrong(Cause.NODE_RESTARTED, detail, nmt_state=self._restarted)
        if self._emcy is None:
            return None
        cause, detail, values = wrong_emergency(self._emcy.code)
        return self._wrong(cause, detail, **values, register=self._emcy.register)

    def read(self) -> ServoReading:
        """Return what the drive last said, and what is wrong with it."""
        age = self._bus.sync_count - self._answered_sync
        self._heartbeat_s = self._bus.now if self._heartbeat_s is None else self._heartbeat_s
        wrong = self._judge(age)
        if self._reset_sync is not None:
            # A drive that has not spoken since is not yet well: it may still be in its fault.
            if wrong is None and self._feedback is not None:
                self._trouble, self._reset_sync = None, None
            elif self._bus.sync_count - self._reset_sync > RESET_SYNCS:
                self._trouble, self._reset_sync = wrong, None
        elif self._trouble is None:
            self._trouble = wrong
        last, drive = self._feedback, self.drive
        if last is None:
            return ServoReading.of_none(age, self._trouble)
        return ServoReading(
            ready=True,
            fresh=age == 0,
            age_syncs=age,
            sampled_s=self._sampled_s,
            position_rad=self._position.rad,
            torque_nm=last.torque * 1e-3 * drive.rated_torque * drive.direction,
            velocity_rad_s=None,
            state=self._state,
            obeyed=self._obeyed,
            statusword=last.statusword,
            trouble=self._trouble,
        )

    def prepare(self, torque: float) -> bool:
        """Tell the drive the room and the torque [N·m] that its joint needs where it stands.

        To be called with its power off, before it is enabled. Returns whether anything had to
        change: then it blocked. Raises `DeviceError`.
        """
        if self._feedback is None:
            return False
        return self._standstill.write(self._position.in_range, torque)

    def request_enable(self) -> None:
        """Step towards *Operation enabled* with the coming writes; not after a stop or trouble."""
        if not self._stopped and self._trouble is None:
            self._aim(_ENABLED)

    def request_disable(self) -> None:
        """Step back to *Switch on disabled* with the coming writes."""
        self._aim(_DISABLED)
        self._seen_enabled = False

    def request_fault_reset(self) -> None:
        """Acknowledge trouble and stop, and reset the drive's fault; it ends up disabled."""
        self.request_disable()
        self._stopped = False
        self._emcy = None
        self._reset_sync = self._bus.sync_count

    def write(self, command: float) -> Sent:
        """Send a setpoint with the controlword of the next step; return what was sent.

        Until *Operation enabled* is seen, and after a stop, what asks for no motion goes out in its
        place (own position, no speed): enabling moves nothing, and what led to a stop is not sent.
        Only in CST is the command sent while the drive is being enabled: behind a closed brake it
        moves nothing, and the torque that holds the arm stands when the brake opens. Raises
        `ValueError` if the command is not finite or beyond its object's bits.
        """
        word = self._controlword()
        if self._feedback is None:
            return Sent(word, None, None)
        held = self._mode is OperationMode.CST or self._state is _ENABLED
        if held and not self._stopped:
            raw = self._setpoint.raw(command)
        else:
            raw = self._setpoint.still(self._feedback.position)
        self._bus.send(self._rpdo_id, self._setpoint.pack(word, raw))
        return Sent(word, raw, self._setpoint.command(raw))

    def tell_ramp(self, deceleration: float) -> None:
        """Send the ramp of a quick stop, which the drive takes over at once [rad/s²]."""
        if self.ramp is not None and self._opened and not self._stopped:
            self.ramp.send(deceleration)

    def stop(self) -> None:
        """Send the quick stop now, and with every write until a reset."""
        self._stopped = True
        self._aim(_DISABLED)
        self._seen_enabled = False
        self._reset_sync = None
        if self._feedback is not None:
            raw = self._setpoint.still(self._feedback.position)
            self._bus.send(self._rpdo_id, self._setpoint.pack(Controlword.QUICK_STOP, raw))

    def close(self) -> None:
        """Take the voltage off and leave the node in *Pre-operational*. Never raises."""
        word, self._opened = Controlword.DISABLE_VOLTAGE.to_bytes(2, "little"), False
        self._bus.expect_no_answers(self._tpdo_id)
        with suppress(SdoError, can.CanError, OSError):
            self.node.sdo.download(Object.CONTROLWORD, 0, word)
        with suppress(can.CanError, OSError):
            self.node.nmt.send_command(can301.NmtCommand.PRE_OPERATIONAL)
        self._forget()

    def _aim(self, target: DriveState) -> None:
        if target is not self._target:
            self._target, self._told_sync = target, self._bus.sync_count

    @property
    def _obeyed(self) -> bool:
        return self._answered_sync - self._told_sync >= OBEYED_SYNCS

    @property
    def _overdue(self) -> bool:
        """True for a drive that should long have switched off."""
        since_s = (self._bus.sync_count - self._told_sync) * self._timing.period_s
        return self._target is _DISABLED and not self._stopped and since_s > SWITCH_OFF_S

    def _controlword(self) -> int:
        # Bit 7 is low for a SYNC first: the drive resets on its rising edge only.
        reset = None if self._reset_sync is None else self._bus.sync_count > self._reset_sync
        return next_word(
            self._state, self._target, stopped=self._stopped, overdue=self._overdue, reset=reset
        )

    def _judge(self, age: int) -> Trouble | None:
        """Return what is wrong now, the cause that explains most first."""
        bus, timing = self._bus, self._timing
        told = self.emergency
        if told is not None:
            return told
        if age > MOST_MISSED_SYNCS:
            return self._wrong(Cause.PDO_LOST, f"no answer to {age} SYNCs", age_syncs=age)
        silence = bus.now - (self._heartbeat_s if self._heartbeat_s is not None else bus.now)
        if silence > timing.heartbeat_timeout_s:
            detail = f"no heartbeat for {silence:.3f} s"
            return self._wrong(Cause.HEARTBEAT_LOST, detail, silence_s=silence)
        if self._feedback is None:
            return None
        word = self._feedback.statusword
        meant = self._target is _ENABLED and self._seen_enabled
        found = wrong_status(word, self._state, meant=meant, overdue=self._overdue)
        return None if found is None else self._wrong(*found, statusword=word)

    def _wrong(self, cause: Cause, detail: str, **values: str | int | float) -> Trouble:
        return Trouble(cause, self.name, detail, {"node": self.drive.node, **values})

    def _on_feedback(self, data: bytes, stamp: float) -> None:
        self.answer_stamp = stamp
        self._feedback = feedback = cia402.unpack_feedback(data)
        self._position.take(feedback.position)
        # After a SYNC without an answer this may be the one to that, late.
        in_turn = self._bus.sync_count - self._answered_sync <= 1
        self._sampled_s = self._bus.sync_s if in_turn else None
        self._answered_sync = self._bus.sync_count
        try:
            self._state = cia402.decode_state(feedback.statusword)
        except FrameError:
            self._state = None
        if self._state is _ENABLED and self._target is _ENABLED and self._obeyed:
            self._seen_enabled = True

    def _on_heartbeat(self, state: int) -> None:
        self._heartbeat_s = self._bus.now
        if state == NmtState.OPERATIONAL:
            self._was_operational = True
        elif self._opened and (self._was_operational or state == NmtState.BOOT_UP):
            self._restarted = state
        if state == NmtState.BOOT_UP:
            self._booted = True

    def _on_emcy(self, emcy: EmcyError) -> None:
        if emcy.code & 0xFF00 != EmcyCode.NO_ERROR:
            self._emcy = emcy
        elif self._reset_sync is not None:
            self._emcy = None
