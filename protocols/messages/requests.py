"""Requests of an operator over Zenoh: queries that always answer.

The envelope, units and conventions are those of `messages.py`.
"""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .messages import (
    Command,
    Count,
    Gains,
    Identifier,
    Key,
    MechanismCommand,
    Message,
    OperatorName,
    TaskCommand,
)

_BiasForce = Annotated[float, Field(ge=-100, le=100)]
_BiasMoment = Annotated[float, Field(ge=-10, le=10)]
Bias = tuple[_BiasForce, _BiasForce, _BiasForce, _BiasMoment, _BiasMoment, _BiasMoment]
"""Reading of a sensor without load [N, N·m]: one that is further off is broken."""

_Lever = Annotated[float, Field(ge=-2, le=2)]
CentreOfMass = tuple[_Lever, _Lever, _Lever]
"""Of a payload, in the Sensor frame [m]: one that is further off is on no arm."""


class LeaseRequest(Message):
    """Asks for the right to command, with a public key that is made for this lease.

    The reply carries the daemon's and the epoch; `proof.py` says how they make the secret.
    """

    operator: OperatorName
    key: Key


class LeaseRelease(Command):
    """Gives the right to command back."""


class ModeRequest(Command):
    """Asks for a mode change: enable, hold, resume, disable, or reset after a fault."""

    action: Literal["enable", "hold", "resume", "disable", "reset"]


class ProtectiveStop(Message):
    """Stops the arm; anyone may ask, lease or not. Latched until cleared.

    `seal` is the SHA-256 of 32 random bytes, made for this one stop and kept: showing them clears
    it. A stop without a seal is the lease holder's to clear.
    """

    operator: OperatorName
    seal: Key | None = None


class ProtectiveClear(Message):
    """Clears protective stops: all of them with a proof of the lease, else the one whose `opens`.

    `opens` are the 32 bytes whose SHA-256 was that stop's seal. Whoever hears them can clear
    nothing with them that is not cleared by them anyway.
    """

    operator: OperatorName
    opens: Key | None = None


class GainRequest(TaskCommand):
    """Sets the gain vector of one source, by its name in the cell file; the change is ramped.

    Gains beyond the bound of sampled stability are refused, unless they are `forced`.
    """

    source: Identifier
    gain: Gains
    forced: bool = False


class SwitchRequest(TaskCommand):
    """Switches one source on or off; the change is ramped."""

    source: Identifier
    on: bool


class HoldTogether(Command):
    """Lets the arms of a joint task hold its payload together, or let go of it; only at rest.

    Without a name it is the cell's only one. While it is on, commands are for that task; those of
    its arms alone are refused. What the grippers do is not part of it.
    """

    task: Identifier | None = None
    on: bool = True


class SpeedRequest(Command):
    """Sets the reduced-speed factor, one factor on all limits but those of stops [1]."""

    factor: float = Field(ge=0.01, le=1.0)


class PayloadRequest(MechanismCommand):
    """Says what hangs on the force/torque sensor now; the change is ramped.

    A name from the cell, or mass [kg] and centre of mass in the Sensor frame [m], or that it is
    `unknown`: force control and following then wait until it is told, or the sensor is tared.
    `bias` is the sensor's reading without load [N, N·m], as in the cell; absent, the one in force
    stays.
    """

    name: str | None = Field(None, max_length=32)
    mass: float | None = Field(None, ge=0, le=500)
    com: CentreOfMass = (0.0, 0.0, 0.0)
    bias: Bias | None = None
    unknown: bool = False

    @model_validator(mode="after")
    def _one_of_three(self) -> "PayloadRequest":
        if (self.name is not None) + (self.mass is not None) + self.unknown != 1:
            raise ValueError("give either name, or mass, or unknown")
        return self


class GripperRequest(MechanismCommand):
    """Closes or opens the gripper; the payload that the cell has for either follows, ramped."""

    closed: bool


class TareRequest(MechanismCommand):
    """Takes the present force/torque reading as that of no contact; refused while moving."""


class AcknowledgeLoad(MechanismCommand):
    """Lets force control and following act on a load that was said to be unexplained."""


class MarkRequest(Command):
    """Marks a moment of a run: an event with a few words, for whoever reads the recording."""

    text: str = Field(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f-\x9f]+$")


class Reply(Message):
    """The answer to every request: accepted, or refused with the reason by name."""

    ok: bool
    reason: str = Field("", max_length=64)
    detail: str = Field("", max_length=500)
    tick: Count = 0
    key: Key | None = None
    """The daemon's public key, with a lease."""
    epoch: Count | None = None
