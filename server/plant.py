"""All devices of one cell as one thing, through the contract and the roles of their drivers."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from ..drivers.device import (
    Cause,
    Device,
    DeviceError,
    DriveReadings,
    InertialSensor,
    JointDrive,
    MeanWrench,
    Peripheral,
    SwitchedOutput,
    Trouble,
    Value,
    WrenchSensor,
)
from ..drivers.fieldbus import Fieldbuses
from ..protocols.canopen.cia402 import DriveState
from .control.spatial import Array

OFF = (DriveState.SWITCH_ON_DISABLED, DriveState.READY_TO_SWITCH_ON)
"""Drive states in which the power stage is off and nothing is wrong."""

LISTEN_S = 0.25
"""Another master is listened for this long before a drive is reset; it sends SYNC oftener [s]."""

TOGETHER_S = 3e-4
"""Drives on several buses sample together if their SYNCs went out within [s]."""

_WELL: Final[Mapping[str, Trouble]] = MappingProxyType({})


class UnitReading(NamedTuple):
    """Newest readings of one arm's devices."""

    q: Array | None
    """Joint angles (n,) [rad]; None before every drive of the cell has told its own."""
    sampled_s: float | None
    """When all of them were sampled [s], on the fieldbus' clock; None when that is not known."""
    tau: Array
    """Joint torques (n,) [N·m]."""
    states: tuple[DriveState | None, ...]
    enabled: bool
    """Every drive of the cell is in Operation enabled, and was told nothing else since."""
    wrench: Array | None
    """Wrench that the arm exerts, at and in the Sensor frame (6,) [N, N·m]; None when stale."""
    wrench_age_s: float | None
    """None where there is no sensor, or it is not opened."""
    wrench_lag_s: float
    """How much older the sample is than the joints' angles, by the bus' own stamps [s]."""
    wrench_mean: MeanWrench | None
    """The same, as the mean of all samples since the reading before; None when stale."""
    wrench_mean_lag_s: float
    """How much older that mean is than the joints' angles [s]."""
    wrench_trouble: Trouble | None
    """Why the sensor's newest sample is none; None where there is no sensor, or it is well."""
    inertial: Array | None
    """Specific force and angular rate (6,) by the arm's inertial unit, in its axes [m/s², rad/s];
    None without, and when stale or saturated."""

    @property
    def wrench_over_period(self) -> tuple[Array, float] | None:
        """The mean wrench (6,) and how much older it is than the joints' angles [s], if fresh."""
        mean = self.wrench_mean
        return None if mean is None else (mean.wrench, self.wrench_mean_lag_s)


class PlantReading(NamedTuple):
    """Newest readings of all devices."""

    q: Array | None
    """All joints' angles (n,) [rad]; None before every drive has told its own."""
    tau: Array
    """Joint torques (n,) [N·m]."""
    states: tuple[DriveState | None, ...]
    obeyed: bool
    """Every drive's state was sampled after what it was last told took effect."""
    enabled: bool
    """Every drive is in Operation enabled, and was told nothing else since."""
    units: tuple[UnitReading, ...]
    """The same for each arm, with what its force/torque sensor tells."""
    trouble: Trouble | None
    interlock: str | None
    """Why a device lets the arms not move; None: all let them."""
    values: Mapping[str, Mapping[str, Value]]
    """Readings of the devices, by their names."""
    unwell: Mapping[str, Trouble]
    """What is wrong with devices that stop nothing, by their names."""

    @property
    def off(self) -> bool:
        """True when every drive's power stage is off and stays so, and none is faulty."""
        return self.obeyed and all(s in OFF for s in self.states)


class _UnitDevices:
    """One arm's drives, in the order of its joints, and its force/torque sensor."""

    def __init__(self, devices: Sequence[Device], first: int) -> None:
        drives = [d for d in devices if isinstance(d, JointDrive)]
        self.joints = slice(first, first + len(drives))
        """Where they are among all drives of the cell."""
        self._sensor = sensor = next((d for d in devices if isinstance(d, WrenchSensor)), None)
        self._inertial = next((d for d in devices if isinstance(d, InertialSensor)), None)
        beside = [i for i, d in enumerate(drives) if sensor is not None and d.bus == sensor.bus]
        self.beside = first + (*beside, 0)[0]
        """Drive whose answers share the clock of the sensor's stamps."""

    def read(
        self, told: DriveReadings, q: Array | None, enabled: bool, opened: bool, stamp: float
    ) -> UnitReading:
        """Return the newest readings; `told` and `q` are of all drives of the cell.

        `stamp` [s] is that of the answer to the SYNC at which all drives sampled.
        """
        own = self.joints
        sample = None if self._sensor is None or not opened else self._sensor.read()
        mean = None if self._sensor is None else self._sensor.mean()
        fresh = sample is not None and sample.wrench is not None and sample.trouble is None
        return UnitReading(
            q=None if q is None else q[own],
            sampled_s=_together(told.sampled_s[own]),
            tau=told.tau[own],
            states=told.states[own],
            enabled=enabled,
            wrench=sample.wrench if sample is not None and fresh else None,
            wrench_age_s=None if sample is None else sample.age_s,
            wrench_lag_s=0.0 if sample is None else stamp - sample.stamp,
            wrench_mean=mean if fresh else None,
            wrench_mean_lag_s=0.0 if mean is None else stamp - mean.stamp,
            wrench_trouble=None if sample is None else sample.trouble,
            inertial=self._felt() if opened else None,
        )

    def _felt(self) -> Array | None:
        told = None if self._inertial is None else self._inertial.read()
        if told is None or told.acceleration is None or told.rate is None:
            return None
        return np.concatenate((told.acceleration, told.rate))


class Plant:
    """Opens, reads, writes and stops every device of a cell."""

    def __init__(self, buses: Fieldbuses, devices: Sequence[Device]) -> None:
        """Build it of the devices in boot order; drives come in the order of the cell's joints."""
        self.buses = buses
        self.devices = tuple(devices)
        self.drives = tuple(d for d in devices if isinstance(d, JointDrive))
        """In the order of the joints."""
        self.opened = False
        self.cyclic = type(self.drives[0]).together(self.drives)
        """What reads and writes the drives."""
        self._others = tuple(d for d in devices if isinstance(d, Peripheral))
        self._watched = tuple(
            d for d in self._others if not d.vital and not isinstance(d, WrenchSensor)
        )
        """Devices that stop nothing, and of which no monitor tells."""
        self._outputs = {d.name: d for d in devices if isinstance(d, SwitchedOutput)}
        names = [drive.bus for drive in self.drives]
        self._by_bus = {bus: [i for i, b in enumerate(names) if b == bus] for bus in names}
        """Places of the drives on each bus."""
        self._units: list[_UnitDevices] = []
        first = 0
        for part in range(max((d.part or 0 for d in self.devices), default=0) + 1):
            own = [d for d in self.devices if (d.part or 0) == part]
            self._units.append(_UnitDevices(own, first))
            first = self._units[-1].joints.stop
        self._commanded = False

    def open(self) -> None:
        """Configure every device; blocks. Raises `DeviceError`.

        Nothing is sent while somebody else commands these drives: they may be moving.
        """
        self.opened = False
        self.buses.clear_trouble()
        self.buses.listen(LISTEN_S)
        trouble = self.buses.trouble
        if trouble is not None:
            raise DeviceError(f"{trouble.device}: {trouble.detail}")
        self._commanded = True
        for device in self.devices:
            device.open()
        self.opened = True

    def answered(self) -> bool:
        """Take in what has come; return whether every drive has answered the last SYNC."""
        self.buses.receive(self.buses.now())
        return all(self.cyclic.answered())

    def emergency(self) -> Trouble | None:
        """Return the trouble that the drives are to be stopped for with the next SYNC, or None.

        Of what was received by now: what is wrong with a bus; what a drive tells of at once, asked
        by no SYNC; or a bus of which no drive has answered the last SYNC, in all of its period,
        while drives of another bus have. Where all buses are silent nobody would hear the stop, and
        a daemon or a network that stood still for a moment is the likelier cause: that is judged
        drive by drive, in `read`.
        """
        trouble = self.buses.trouble or self.cyclic.emergency()
        if trouble is not None or len(self._by_bus) == 1:
            return trouble
        answered = self.cyclic.answered()
        silent = {b: not any(answered[i] for i in own) for b, own in self._by_bus.items()}
        if all(silent.values()):
            return None
        for bus, quiet in silent.items():
            if quiet and len(self._by_bus[bus]) > 1:
                return self._bus_silent(bus)
        return None

    def read(self, now_s: float) -> PlantReading:
        """Return the newest readings of all devices."""
        self.buses.receive(now_s)
        told = self.cyclic.read()
        q = told.q if self.opened and told.heard else None
        enabled = told.obeyed and all(s is DriveState.OPERATION_ENABLED for s in told.states)
        trouble = self._find_trouble(told.troubles)
        units = tuple(
            unit.read(told, q, enabled, self.opened, self.cyclic.stamp(unit.beside))
            for unit in self._units
        )
        return PlantReading(
            q=q,
            tau=told.tau,
            states=told.states,
            obeyed=told.obeyed,
            enabled=enabled,
            units=units,
            trouble=trouble if self.opened else None,
            interlock=self._interlock() if self.opened else None,
            values={d.name: shown for d in self._others if (shown := d.values())},
            unwell=self._unwell() if self.opened and self._watched else _WELL,
        )

    def write(self, command: Array) -> None:
        """Send every drive its setpoint (n,): rad, rad/s or N·m, as the operation mode is."""
        self.cyclic.write(command)

    def switch(self, outputs: Mapping[str, bool]) -> None:
        """Keep outputs on or off, by name; one that is not named stays as it is."""
        for name, on in outputs.items():
            self._outputs[name].write(on)

    def prepare(self, torque: Array) -> bool:
        """Prepare every drive for where its joint stands, and torques (n,) that hold it [N·m].

        To be called with all drives off. Returns whether it blocked; raises `DeviceError`.
        """
        blocked = False
        for drive, held in zip(self.drives, torque.tolist(), strict=True):
            blocked = drive.prepare(held) or blocked
        return blocked

    def enable(self) -> None:
        """Ask every drive for Operation enabled."""
        for drive in self.drives:
            drive.request_enable()

    def disable(self) -> None:
        """Ask every drive to switch its power off."""
        for drive in self.drives:
            drive.request_disable()

    def reset(self) -> None:
        """Ask every drive to leave its fault."""
        for drive in self.drives:
            drive.request_fault_reset()

    def quick_stop(self, ramps: Mapping[int, float] | None = None) -> None:
        """Stop every device by its own means, now: the drives on their own ramps.

        `ramps` [rad/s²] are told before to drives that can be, by their places among all.
        """
        for i, ramp in (ramps or {}).items():
            self.drives[i].tell_ramp(ramp)
        for device in self.devices:
            device.stop()

    def close(self) -> None:
        """Stop and let go of every device, unless it was never ours."""
        if self._commanded:
            self.quick_stop()
            for device in self.devices:
                device.close()
        self.buses.close()

    def _find_trouble(self, of_drives: Sequence[Trouble | None]) -> Trouble | None:
        """Return the first trouble that no device can go on with: of a bus, drives, others."""
        if self.buses.trouble is not None:
            return self.buses.trouble
        for drive, trouble in zip(self.drives, of_drives, strict=True):
            if trouble is not None:
                return self._silent_bus(drive.bus, of_drives) or trouble
        for device in self._others:
            if device.vital:
                trouble = device.read().trouble
                if trouble is not None:
                    return trouble
        return None

    def _unwell(self) -> dict[str, Trouble]:
        read = ((device.name, device.read().trouble) for device in self._watched)
        return {name: trouble for name, trouble in read if trouble is not None}

    def _silent_bus(self, bus: str, of_drives: Sequence[Trouble | None]) -> Trouble | None:
        """Return that a whole bus is silent, where that explains the trouble of a drive on it."""
        own = [of_drives[i] for i in self._by_bus[bus]]
        lost = [t for t in own if t is not None and t.cause is Cause.PDO_LOST]
        return None if len(own) < 2 or len(lost) < len(own) else self._bus_silent(bus)

    def _bus_silent(self, bus: str) -> Trouble:
        """Return that none of the drives of a bus answers."""
        own = [self.drives[i].name for i in self._by_bus[bus]]
        detail = f"none of its {len(own)} drives answers, {own[0]} to {own[-1]}"
        return Trouble(Cause.BUS_SILENT, bus, detail, {"drives": len(own)})

    def _interlock(self) -> str | None:
        for device in self._others:
            reason = device.interlock()
            if reason is not None:
                return reason
        return None


def _together(sampled_s: Sequence[float | None]) -> float | None:
    """Return when drives sampled, if all did at one instant [s]."""
    first = sampled_s[0]
    for at_s in sampled_s:
        if first is None or at_s is None or abs(at_s - first) > TOGETHER_S:
            return None
    return first
