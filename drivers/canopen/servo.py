"""CiA 402 servo drives in a cyclic synchronous mode: each by itself, and all in a period."""

import struct
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

import can
import canopen
import numpy as np
from canopen.emcy import EmcyError
from canopen.sdo.exceptions import SdoError
from numpy.typing import NDArray

from ...config.schema.cell import TimingSection
from ...config.schema.mechanism import DriveSection
from ...protocols.canopen import can301, cia402
from ...protocols.canopen.can301 import CommunicationObject as Com
from ...protocols.canopen.can301 import EmcyCode, FrameError, NmtState
from ...protocols.canopen.cia402 import (
    Controlword,
    DriveState,
    Object,
    OperationMode,
    Status,
    Unwrapped,
)
from ..device import (
    MOST_MISSED_SYNCS,
    OBEYED_SYNCS,
    RESET_SYNCS,
    SWITCH_OFF_S,
    Cause,
    DeviceError,
    DriveReadings,
    JointDrive,
    JointDrives,
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


# --- What is known of n drives and asked of them, as arrays: each drive owns a place in them -----

BOOT_TIMEOUT_S: Final = 2.0
_ENABLED: Final = DriveState.OPERATION_ENABLED
_DISABLED: Final = DriveState.SWITCH_ON_DISABLED
_STATES: Final = (*DriveState, None)
"""States by their code; the last one is of a statusword that means none."""
_STATE_BITS: Final = 0x6F
_WELL_MASK: Final = _STATE_BITS | Status.VOLTAGE_ENABLED | Status.FOLLOWING_ERROR
_WELL: Final = cia402.STATE_BITS[DriveState.OPERATION_ENABLED] | Status.VOLTAGE_ENABLED
"""Bits of a statusword with which nothing is wrong."""


def _code(bits: int) -> int:
    with suppress(FrameError):
        return _STATES.index(cia402.decode_state(bits))
    return _STATES.index(None)


_CODES: Final = bytes(_code(bits) for bits in range(_STATE_BITS + 1))
"""Code of the state that a statusword's bits mean."""
_ENABLED_CODE: Final = _STATES.index(_ENABLED)


class _Status:
    """What n drives told and were told, one entry each; counts are of SYNCs."""

    def __init__(self, n: int) -> None:
        self.feedback = bytearray(n * cia402.FEEDBACK.size)
        """TPDO1 of all drives as they came, one after the other."""
        self.heard, self.enabling, self.seen_enabled, self.stopped = [[False] * n for _ in range(4)]
        self.answered, self.told, self.stamp = [0] * n, [0] * n, [0.0] * n
        self.reset: list[int | None] = [None] * n
        """When a reset of its fault was asked for; None for none."""
        self.sampled_s: list[float | None] = [None] * n
        self.heartbeat_s: list[float | None] = [None] * n
        self.troubles: list[Trouble | None] = [None] * n
        self.alarmed: set[int] = set()
        """Drives that told of something, asked by no SYNC."""


# --- A CiA 402 servo drive in a cyclic synchronous mode, as one joint -----------------------------


class ServoDrive(JointDrive):
    """One joint's drive; keeps the contract of `device.py`.

    `lower` and `upper` are the joint's limits [rad] (607Dh); `mode` says what a setpoint is: rad in
    CSP, rad/s in CSV, N·m in CST; `eds` names the drive's objects. A wheel is `endless`: its
    counter of 32 bits wraps, and it has no limits. A node that restarted has lost its
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
        self.drive, self.name, self.mode = drive, drive.joint, mode
        self.setpoint = Setpoint(drive, mode)
        self.fieldbus, self.bus = fieldbus, fieldbus.name
        self.timing = timing
        self.turns = Unwrapped() if endless else None
        """Counts of a wheel."""
        self._limits = servo_setup.whole_range(drive) if endless else (lower, upper)
        self.node = fieldbus.add_node(drive.node, eds, self._on_heartbeat)
        self._standstill = Standstill(self.node, drive, mode, *self._limits)
        self.node.emcy.add_callback(self._on_emcy)
        self._tpdo_id = can301.tpdo1_id(drive.node)
        fieldbus.listen(self._tpdo_id, self._on_feedback)
        self.rpdo_id = can301.rpdo1_id(drive.node)
        self.ramp: StopRamp | None = None
        """Tells the drive the ramp of a quick stop, set before it is opened; None: its own."""
        self._booted = self._opened = False
        self.move(_Status(1), 0)

    @classmethod
    def together(cls, drives: Sequence[JointDrive]) -> "ServoDrives":
        """Return what reads and writes these drives, in this order."""
        return ServoDrives([drive for drive in drives if isinstance(drive, cls)])

    def move(self, status: _Status, place: int) -> None:
        """Take a place in the arrays of several drives. It has told nothing yet."""
        self._s, self._i = status, place
        size = cia402.FEEDBACK.size
        self._bytes = slice(place * size, (place + 1) * size)
        self._forget()

    def _forget(self) -> None:
        s, i, count = self._s, self._i, self.fieldbus.sync_count
        s.feedback[self._bytes] = bytes(cia402.FEEDBACK.size)
        s.heard[i] = s.enabling[i] = s.seen_enabled[i] = s.stopped[i] = False
        s.answered[i] = s.told[i] = count
        s.reset[i] = s.sampled_s[i] = s.heartbeat_s[i] = s.troubles[i] = None
        self._was_operational = False
        self._restarted: int | None = None
        self._emcy: EmcyError | None = None
        s.alarmed.discard(i)

    def open(self) -> None:
        """Reset the node's communication, configure it and start it. Blocks; `DeviceError`."""
        self._booted = self._opened = False
        self.fieldbus.expect_no_answers(self._tpdo_id)
        try:
            self.node.nmt.send_command(can301.NmtCommand.RESET_COMMUNICATION)
            if not self.fieldbus.wait_until(lambda: self._booted, BOOT_TIMEOUT_S):
                missing = f"no boot-up message within {BOOT_TIMEOUT_S} s of a reset"
                raise DeviceError(f"{self.name} (node {self.drive.node}): {missing}")
            servo_setup.configure(
                self.node, self.drive, self.timing, *self._limits, self.mode, self.fieldbus.pause
            )
            if self.ramp is not None:
                self.ramp.map()
            self._standstill.configured()
            self.fieldbus.expect_answers(self._tpdo_id)
            self.node.nmt.send_command(can301.NmtCommand.START)
        except can.CanError as error:
            raise DeviceError(f"{self.name} (node {self.drive.node}): {error}") from error
        self._forget()
        self._opened = True

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

    def prepare(self, torque: float) -> bool:
        """Tell the drive the room and the torque [N·m] that its joint needs where it stands.

        To be called with its power off, before it is enabled. Returns whether anything had to
        change: then it blocked. Raises `DeviceError`.
        """
        if not self._s.heard[self._i]:
            return False
        # Wherever a wheel stands, 607Dh has room enough.
        q = servo_setup.to_radians(self.drive, self._told.position if self.turns is None else 0)
        return self._standstill.write(q, torque)

    def request_enable(self) -> None:
        """Step towards *Operation enabled* with the coming writes; not after a stop or trouble."""
        if not self._s.stopped[self._i] and self._s.troubles[self._i] is None:
            self._aim(True)

    def request_disable(self) -> None:
        """Step back to *Switch on disabled* with the coming writes."""
        self._aim(False)
        self._s.seen_enabled[self._i] = False

    def request_fault_reset(self) -> None:
        """Acknowledge trouble and stop, and reset the drive's fault; it ends up disabled."""
        self.request_disable()
        self._s.stopped[self._i] = False
        self._emcy = None
        self._note_alarm()
        self._s.reset[self._i] = self.fieldbus.sync_count

    def tell_ramp(self, deceleration: float) -> None:
        """Send the ramp of a quick stop, which the drive takes over at once [rad/s²]."""
        if self.ramp is not None and self._opened and not self._s.stopped[self._i]:
            self.ramp.send(deceleration)

    def stop(self) -> None:
        """Send the quick stop now, and with every write until a reset."""
        s, i = self._s, self._i
        self.request_disable()
        s.stopped[i], s.reset[i] = True, None
        if s.heard[i]:
            raw = self.setpoint.still(self._told.position)
            self.fieldbus.send(self.rpdo_id, self.setpoint.pack(Controlword.QUICK_STOP, raw))

    def close(self) -> None:
        """Take the voltage off and leave the node in *Pre-operational*. Never raises."""
        word, self._opened = Controlword.DISABLE_VOLTAGE.to_bytes(2, "little"), False
        self.fieldbus.expect_no_answers(self._tpdo_id)
        with suppress(SdoError, can.CanError, OSError):
            self.node.sdo.download(Object.CONTROLWORD, 0, word)
        with suppress(can.CanError, OSError):
            self.node.nmt.send_command(can301.NmtCommand.PRE_OPERATIONAL)
        self._forget()

    def judge(self, age: int, overdue: bool) -> Trouble | None:
        """Return what is wrong now, the cause that explains most first.

        It last answered so many SYNCs ago; `overdue`: it should long have switched off.
        """
        s, i, timing = self._s, self._i, self.timing
        told = self.emergency
        if told is not None:
            return told
        if age > MOST_MISSED_SYNCS:
            return self._wrong(Cause.PDO_LOST, f"no answer to {age} SYNCs", age_syncs=age)
        heard_s = s.heartbeat_s[i]
        silence = 0.0 if heard_s is None else self.fieldbus.now - heard_s
        if silence > timing.heartbeat_timeout_s:
            detail = f"no heartbeat for {silence:.3f} s"
            return self._wrong(Cause.HEARTBEAT_LOST, detail, silence_s=silence)
        if not s.heard[i]:
            return None
        word, meant = self._told.statusword, s.enabling[i] and s.seen_enabled[i]
        state = _STATES[_CODES[word & _STATE_BITS]]
        found = wrong_status(word, state, meant=meant, overdue=overdue)
        return None if found is None else self._wrong(*found, statusword=word)

    @property
    def _told(self) -> cia402.Feedback:
        return cia402.unpack_feedback(self._s.feedback[self._bytes])

    def _aim(self, enabling: bool) -> None:
        if enabling != self._s.enabling[self._i]:
            self._s.enabling[self._i] = enabling
            self._s.told[self._i] = self.fieldbus.sync_count

    def _wrong(self, cause: Cause, detail: str, **values: str | int | float) -> Trouble:
        return Trouble(cause, self.name, detail, {"node": self.drive.node, **values})

    def _on_feedback(self, data: bytes, stamp: float) -> None:
        if len(data) != cia402.FEEDBACK.size:
            raise FrameError(f"TPDO1: {len(data)} bytes instead of {cia402.FEEDBACK.size}")
        s, i, bus = self._s, self._i, self.fieldbus
        s.feedback[self._bytes] = data
        # After a SYNC without an answer this may be the one to that, late.
        s.sampled_s[i] = bus.sync_s if bus.sync_count - s.answered[i] <= 1 else None
        s.answered[i], s.stamp[i], s.heard[i] = bus.sync_count, stamp, True
        if s.enabling[i] and not s.seen_enabled[i] and bus.sync_count - s.told[i] >= OBEYED_SYNCS:
            s.seen_enabled[i] = _CODES[self._told.statusword & _STATE_BITS] == _ENABLED_CODE

    def _on_heartbeat(self, state: int) -> None:
        self._s.heartbeat_s[self._i] = self.fieldbus.now
        if state == NmtState.OPERATIONAL:
            self._was_operational = True
        elif self._opened and (self._was_operational or state == NmtState.BOOT_UP):
            self._restarted = state
            self._note_alarm()
        if state == NmtState.BOOT_UP:
            self._booted = True

    def _on_emcy(self, emcy: EmcyError) -> None:
        if emcy.code & 0xFF00 != EmcyCode.NO_ERROR:
            self._emcy = emcy
        elif self._s.reset[self._i] is not None:
            self._emcy = None
        self._note_alarm()

    def _note_alarm(self) -> None:
        told = self._restarted is not None or self._emcy is not None
        (self._s.alarmed.add if told else self._s.alarmed.discard)(self._i)


# --- The cyclic part of all such drives -----------------------------------------------------------


class ServoDrives(JointDrives):
    """Reads and writes n drives at once; keeps the contract of `device.py`.

    `read` judges by what `Fieldbus.receive` dispatched and by its `now`. A drive's first trouble
    stays until `request_fault_reset` finds its cause gone.
    """

    def __init__(self, drives: Sequence[ServoDrive]) -> None:
        """Give each drive its place."""
        self._drives, self._s = tuple(drives), _Status(len(drives))
        for place, drive in enumerate(drives):
            drive.move(self._s, place)
        self._buses = tuple(drive.fieldbus for drive in drives)
        self._layout = struct.Struct("<" + len(drives) * cia402.FEEDBACK_FIELDS)
        sections = [drive.drive for drive in drives]
        self._scales = [(d.zero_rad, d.direction, d.counts_per_radian) for d in sections]
        self._torques = [(d.rated_torque, d.direction) for d in sections]
        self._wheels = [(i, d.turns) for i, d in enumerate(drives) if d.turns is not None]

    def answered(self) -> tuple[bool, ...]:
        """Return which drives have answered the newest SYNC."""
        s = self._s
        each = zip(s.heard, s.answered, self._buses, strict=True)
        return tuple([heard and at == bus.sync_count for heard, at, bus in each])

    def stamp(self, drive: int) -> float:
        """Return the bus' stamp of a drive's newest TPDO1 [s], which a SYNC asked for."""
        return self._s.stamp[drive]

    def emergency(self) -> Trouble | None:
        """Return the trouble that the first of those drives told of which told of any."""
        return self._drives[min(self._s.alarmed)].emergency if self._s.alarmed else None

    def read(self) -> DriveReadings:
        """Return what the drives last said, and what is wrong with them."""
        s, fields = self._s, self._layout.unpack(self._s.feedback)
        codes = [_CODES[word & _STATE_BITS] for word in fields[::3]]
        ages = [bus.sync_count - at for bus, at in zip(self._buses, s.answered, strict=True)]
        self._judge(fields[::3], ages)
        counts, heard = list(fields[1::3]), all(s.heard)
        for i, turns in self._wheels:
            if s.heard[i]:
                counts[i] = turns.take(counts[i])
        of_joint = zip(self._scales, counts, strict=True)
        of_motor = zip(self._torques, fields[2::3], strict=True)
        return DriveReadings(
            heard=heard,
            age_syncs=tuple(ages),
            sampled_s=tuple(s.sampled_s),
            q=np.array([zero + sign * count / scale for (zero, sign, scale), count in of_joint]),
            tau=np.array([t * 1e-3 * rated * sign or 0.0 for (rated, sign), t in of_motor]),
            states=tuple(
                [_STATES[c] if known else None for c, known in zip(codes, s.heard, strict=True)]
            ),
            obeyed=heard
            and all(a - t >= OBEYED_SYNCS for a, t in zip(s.answered, s.told, strict=True)),
            troubles=tuple(s.troubles),
        )

    def write(self, command: NDArray[np.float64]) -> None:
        """Send setpoints (n,) with the controlwords of the next step.

        Until *Operation enabled* is seen, and after a stop, what asks for no motion goes out in its
        place (own position, no speed): enabling moves nothing, and what led to a stop is not sent.
        Only in CST is the command sent while the drive is being enabled: behind a closed brake it
        moves nothing, and the torque that holds the arm stands when the brake opens. Before its
        first answer a drive is sent nothing. Raises `ValueError` if a command is not finite or
        beyond its object's bits: then none is sent.
        """
        s, frames = self._s, []
        fields = self._layout.unpack(s.feedback)
        each = zip(self._drives, command.tolist(), fields[::3], fields[1::3], strict=True)
        for i, (drive, asked, status, position) in enumerate(each):
            if not s.heard[i]:
                continue
            state, stopped = _STATES[_CODES[status & _STATE_BITS]], s.stopped[i]
            held = state is _ENABLED or drive.mode is OperationMode.CST
            setpoint = drive.setpoint
            raw = setpoint.raw(asked) if held and not stopped else setpoint.still(position)
            word: int = Controlword.ENABLE_OPERATION
            if state is not _ENABLED or stopped or not s.enabling[i]:
                count, reset = drive.fieldbus.sync_count, s.reset[i]
                word = next_word(
                    state,
                    _ENABLED if s.enabling[i] else _DISABLED,
                    stopped=stopped,
                    overdue=self._overdue(i),
                    # Bit 7 is low for a SYNC first: the drive resets on its rising edge only.
                    reset=None if reset is None else count > reset,
                )
            frames.append((drive, setpoint.pack(word, raw)))
        for drive, data in frames:
            drive.fieldbus.send(drive.rpdo_id, data)

    def _overdue(self, i: int) -> bool:
        """Return whether a drive should long have switched off."""
        if self._s.enabling[i] or self._s.stopped[i]:
            return False
        since = self._buses[i].sync_count - self._s.told[i]
        return since * self._drives[i].timing.period_s > SWITCH_OFF_S

    def _judge(self, words: Sequence[int], ages: Sequence[int]) -> None:
        """Judge all drives by their statuswords and ages; note the first trouble of each."""
        s = self._s
        for i, drive in enumerate(self._drives):
            bus, reset, heartbeat_s = drive.fieldbus, s.reset[i], s.heartbeat_s[i]
            if heartbeat_s is None:
                heartbeat_s = s.heartbeat_s[i] = bus.now
            well = (
                words[i] & _WELL_MASK == _WELL
                and s.enabling[i]
                and ages[i] <= MOST_MISSED_SYNCS
                and bus.now - heartbeat_s <= drive.timing.heartbeat_timeout_s
            )
            if well and reset is None and not s.alarmed:
                continue
            trouble = drive.judge(ages[i], self._overdue(i))
            if reset is None:
                s.troubles[i] = s.troubles[i] or trouble
            # A drive that has not spoken since is not yet well: it may still be in its fault.
            elif (
                trouble is None and s.heard[i]
            ) or drive.fieldbus.sync_count - reset > RESET_SYNCS:
                s.troubles[i], s.reset[i] = trouble, None
