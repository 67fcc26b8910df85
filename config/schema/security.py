"""Who may speak on the operators' network: certificates, or a clear word that there are none."""

import ipaddress
from pathlib import Path
from typing import Self

from pydantic import Field, model_validator

from ..errors import ConfigError
from .section import Section

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
