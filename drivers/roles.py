"""Roles of devices: a joint's drive, a wrench sensor, an output; and their readings."""

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .device import Device, Trouble
from .servo_status import Sent, ServoReading


@dataclass(frozen=True, slots=True)
class WrenchReading:
    """The newest sample. Until the first one came there is none: `ready` is false."""

    ready: bool
    wrench: NDArray[np.float64] | None
    """(6,) [N, N·m], force first: what the arm exerts on its environment, at the Sensor frame's
    origin and in its axes. Weight and bias are still in it."""
    stamp: float
    """The bus' stamp of the sample's second half [s], on the bus' own clock."""
    age_s: float
    trouble: Trouble | None


@dataclass(frozen=True, slots=True)
class MeanWrench:
    """The mean of several samples, without the aliases that any one of them alone has."""

    wrench: NDArray[np.float64]
    """(6,) [N, N·m], signed and placed as a `WrenchReading`'s."""
    stamp: float
    """Mean of their stamps [s], on the bus' own clock."""
    jump: NDArray[np.float64]
    """By how much a sample is off its two neighbours' mean (6,), where it is most [N, N·m]: contact
    that chatters between samples is known no better."""


class JointDrive(Device):
    """Drive of one joint, whose setpoint is rad, rad/s or N·m as its operation mode is."""

    answer_stamp: float
    """The bus' stamp of the newest answer to a SYNC [s], on the bus' own clock."""

    @property
    @abstractmethod
    def answered(self) -> bool:
        """True once the drive has answered the newest SYNC."""

    @property
    def emergency(self) -> Trouble | None:
        """Trouble that the drive tells of at once, asked by no SYNC; None where it tells none."""
        return None

    @abstractmethod
    def read(self) -> ServoReading:
        """Return the newest answer, and what is wrong with it."""

    @abstractmethod
    def write(self, command: float) -> Sent:
        """Send a setpoint; return what was sent. Raises `ValueError` for one out of range."""

    @abstractmethod
    def request_enable(self) -> None:
        """Step towards *Operation enabled* with the coming writes."""

    @abstractmethod
    def request_disable(self) -> None:
        """Step towards power off with the coming writes."""

    @abstractmethod
    def request_fault_reset(self) -> None:
        """Acknowledge trouble and stop, and reset the drive's fault."""

    def tell_ramp(self, deceleration: float) -> None:
        """Tell the ramp of a quick stop that is about to be sent [rad/s²].

        A drive that cannot be told keeps its own.
        """

    @abstractmethod
    def prepare(self, torque: float) -> bool:
        """Prepare the drive, while off, for its joint's position, and a torque that holds it [N·m].

        Returns whether it blocked.
        """


class WrenchSensor(Device):
    """Force/torque sensor at the wrist."""

    @abstractmethod
    def read(self) -> WrenchReading:
        """Return the newest sample."""

    @abstractmethod
    def mean(self) -> MeanWrench | None:
        """Return the mean of the samples since the last call; None before the first sample."""


class SwitchedOutput(Device):
    """Something that is switched on and off."""

    @abstractmethod
    def write(self, command: bool) -> bool:
        """Switch it, now and with every call; return what was commanded."""
