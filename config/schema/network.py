"""Schema of the operators' network: who may speak on it, and the forces that go back over it."""

import ipaddress
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from ..errors import ConfigError
from .section import Section

# --- Who may speak on the operators' network: certificates, or a clear word that there are none ---

SECURE = "tls/"
"""Endpoints at which both sides show a certificate begin so."""

_LOCAL = ("unixsock-stream/", "unixpipe/")


class SecuritySection(Section):
    """Certificates, made by `telerobot certify`; without any, only this machine is spoken to."""

    directory: str | None = Field(
        None,
        min_length=1,
        max_length=4096,
        description="folder of the certificates, from this file's folder; absent: none are used",
    )
    insecure: bool = Field(
        False,
        description="listen beyond this machine without certificates: whoever reaches the daemon "
        "may move the arm",
    )

    @model_validator(mode="after")
    def _one_or_the_other(self) -> Self:
        if self.insecure and self.directory is not None:
            raise ValueError("'insecure' is for a daemon without certificates, not with them")
        return self


class ZenohSection(Section):
    """Where operators reach the daemon. Loopback only unless said otherwise."""

    listen: str = Field(
        "tcp/127.0.0.1:7447",
        pattern=r"^[a-z][a-z0-9-]*/\S+$",
        description="endpoint that the daemon listens on and operators dial",
    )
    router: str | None = Field(
        None,
        pattern=r"^[a-z][a-z0-9-]*/\S+$",
        description="endpoint of a common Zenoh router: daemon and operators dial it, and the "
        "daemon listens nowhere",
    )
    security: SecuritySection = Field(default_factory=SecuritySection, description="who may speak")

    @property
    def endpoint(self) -> str:
        """Where the daemon is reached: at the common router, if there is one."""
        return self.router or self.listen

    @property
    def key(self) -> str:
        """The key that says `endpoint`."""
        return "listen" if self.router is None else "router"

    @property
    def dialled(self) -> str:
        """The endpoint as others on the daemon's machine dial it."""
        for everywhere, here in (("/0.0.0.0:", "/127.0.0.1:"), ("/[::]:", "/[::1]:")):
            if everywhere in self.endpoint:
                return self.endpoint.replace(everywhere, here)
        return self.endpoint

    @property
    def exposed(self) -> bool:
        """True where other machines may reach the daemon, and show no certificate."""
        return not self.endpoint.startswith(SECURE) and beyond_loopback(self.endpoint)


def beyond_loopback(endpoint: str) -> bool:
    """Return True for an endpoint that other machines may reach.

    A host that is neither `localhost` nor an address of loopback may be anything.
    """
    if endpoint.startswith(_LOCAL):
        return False
    address = endpoint.partition("/")[2].partition("#")[0].partition("?")[0]
    host = address.rpartition(":")[0].removeprefix("[").removesuffix("]")
    if host == "localhost":
        return False
    try:
        return not ipaddress.ip_address(host).is_loopback
    except ValueError:
        return True


def refuse_exposure(zenoh: ZenohSection, path: Path) -> None:
    """Raise `ConfigError` for a daemon that anybody may reach and command, and no word of it.

    `path` is the cell file's, for the message.
    """
    if zenoh.exposed and not zenoh.security.insecure:
        raise ConfigError(
            f"{path}: zenoh.{zenoh.key}: value '{zenoh.endpoint}': beyond this machine "
            "anybody could command; make certificates (telerobot certify), or say "
            "zenoh.security.insecure = true"
        )


# --- Schema of force reflection: how much goes back, to which handle and hand ---------------------

Share = Annotated[float, Field(ge=0, le=1)]
Gain = Annotated[float, Field(ge=0, le=10)]


class HandleSection(Section):
    """The operator's force-reflecting device, as `check` and the simulated one take it."""

    mass: float = Field(0.4, gt=0, le=10, description="felt at the handle [kg]")
    damping: float = Field(4.0, ge=0, le=100, description="of the mechanism [N·s/m]")
    spring: float = Field(
        100.0, gt=0, le=1e4, description="to its centre, while it is a stick [N/m]"
    )
    spring_damping: float = Field(6.0, ge=0, le=1000, description="with that spring [N·s/m]")
    travel: float = Field(0.04, gt=0, le=0.5, description="full deflection of the stick [m]")
    speed: float = Field(0.06, gt=0, le=5, description="what full deflection asks for [m/s]")
    max_force: float = Field(8.0, gt=0, le=200, description="of the device's motors [N]")


class HandSection(Section):
    """The softest hand that is expected to hold the handle."""

    stiffness: float = Field(200.0, ge=0, le=1e4, description="grasp and arm [N/m]")
    damping: float = Field(7.0, ge=0, le=500, description="the same [N·s/m]")


class ReflectionSection(Section):
    """Force reflection: the MRF's wrench, scaled, on the operator's handle (K_FR)."""

    gain: tuple[Gain, Gain, Gain, Gain, Gain, Gain] = Field(
        (0.15, 0.15, 0.15, 0.0, 0.0, 0.0),
        description="K_FR: part of the wrench that is reflected, per axis of the MRF [1]",
    )
    stiffness: float = Field(
        100.0,
        gt=0,
        le=1e5,
        description="greatest stiffness that a master's pose is to feel: K_FR is lowered to it "
        "[N/m]",
    )
    largest_round_trip_s: float = Field(
        0.5, ge=0, le=5, description="longest way to the operator and back that is expected [s]"
    )
    jitter: Share = Field(0.2, description="how much that varies to either side, a part of it [1]")
    energy_bound: float = Field(
        0.05,
        gt=0,
        le=10,
        description="most energy that reflection may give the hand within seconds [J]",
    )
    handle: HandleSection = Field(
        default_factory=HandleSection, description="the operator's device"
    )
    hand: HandSection = Field(default_factory=HandSection, description="the softest hand on it")
