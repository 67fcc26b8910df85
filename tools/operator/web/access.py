"""Who may see the page, and who may drive through it: secrets, cookies, certificates, origins.

Two secrets are drawn at start: whoever knows the operators' may drive, whoever knows the
observers' may watch (and stop the arm). One stands in the address of the first visit; from then on
a cookie made from it does. Beyond this machine there is HTTPS, and a browser that shows a
certificate of `[zenoh.security]` has the role that the certificate grants.
"""

import asyncio
import hashlib
import hmac
import ipaddress
import secrets
import ssl
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

from ....config.errors import ConfigError
from ....drivers.network.certificates import AUTHORITY
from ....drivers.network.identity import Identity
from ....protocols.roles import Grant
from ....protocols.topics import Role

_RANK: Final = (Role.OPERATOR, Role.OBSERVER)
"""Roles of a page, the one that may do more first."""


@dataclass(frozen=True)
class Listen:
    """Where the console listens: `HOST:PORT`; port 0 takes any that is free."""

    host: str
    port: int

    @classmethod
    def parse(cls, text: str) -> "Listen":
        """Read `HOST:PORT`. Raises `ConfigError`."""
        host, colon, port = text.rpartition(":")
        host = host.removeprefix("[").removesuffix("]")
        if not colon or not host or not port.isdecimal() or int(port) > 65535:
            raise ConfigError(f"--listen: value {text}: write HOST:PORT, such as 127.0.0.1:8080")
        return cls(host, int(port))

    @property
    def beyond(self) -> bool:
        """True where other machines may reach it."""
        if self.host == "localhost":
            return False
        try:
            return not ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return True

    def names(self, port: int) -> frozenset[str]:
        """Return what a browser writes into `Host`; nothing where that may be any.

        A page of somewhere else whose name was made to lead here is turned away by it.
        """
        if self.beyond:
            return frozenset()
        shown = f"[{self.host}]" if ":" in self.host else self.host
        return frozenset(f"{host}:{port}" for host in (shown, "localhost", "127.0.0.1", "[::1]"))


SHORTEST: Final = 16
"""A secret of fewer characters is refused: it could be guessed [1]."""

DEADLINE_S: Final = 10.0
"""A connection, or a form, that is not whole by then is given up [s]."""
MOST: Final = 64
"""Connections from one address, or one network of IPv6 (/64), at a time [1]."""


class Doorkeeper:
    """Ends connections that keep the console waiting, and those of an address that has too many."""

    def __init__(self) -> None:
        self._since: dict[asyncio.BaseTransport, float] = {}
        self._served: set[asyncio.BaseTransport] = set()

    def served(self, connection: asyncio.BaseTransport | None) -> None:
        """Note that a whole request came on a connection."""
        if connection is not None:
            self._served.add(connection)

    def sweep(self, connections: Iterable[asyncio.Transport], now_s: float) -> None:
        """End what has waited too long, or is too many, of those that are open."""
        there = list(connections)
        self._since = {each: self._since.get(each, now_s) for each in there}
        self._served.intersection_update(there)
        of: dict[str, list[asyncio.Transport]] = {}
        for each in there:
            if each not in self._served and now_s - self._since[each] >= DEADLINE_S:
                each.abort()
            else:
                of.setdefault(_network_of(each.get_extra_info("peername")), []).append(each)
        for open_ in of.values():
            # Who has sent a whole request stays before those who have not.
            open_.sort(key=lambda each: (each not in self._served, self._since[each]))
            for each in open_[MOST:]:
                each.abort()


def _network_of(peer: tuple[Any, ...] | None) -> str:
    """Return the address of a peer, of IPv6 the network that one machine may have to itself."""
    host = str(peer[0]) if peer else ""
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if isinstance(address, ipaddress.IPv6Address) and not address.ipv4_mapped:
        return str(ipaddress.ip_network((address, 64), strict=False))
    return str(address)


@dataclass(frozen=True)
class Access:
    """Secrets of one console, and what they open. Raises `ConfigError` for a short one."""

    cell: str
    keys: Mapping[Role, str] = field(
        default_factory=lambda: {role: secrets.token_urlsafe(24) for role in _RANK}
    )

    def __post_init__(self) -> None:
        for role, key in self.keys.items():
            if len(key) < SHORTEST:
                raise ConfigError(
                    f"the {role}s' secret: {len(key)} characters: must be at least {SHORTEST}"
                )

    def role_of_key(self, key: str) -> Role | None:
        """Return the role that a secret gives; None for no secret of this console."""
        shown = key.encode(errors="replace")
        found = [r for r in _RANK if hmac.compare_digest(self.keys[r].encode(), shown)]
        return found[0] if found else None

    def role_of_cookie(self, cookie: str) -> Role | None:
        """Return the role that a cookie gives; None for none of this console's."""
        shown = cookie.encode(errors="replace")
        found = [r for r in _RANK if hmac.compare_digest(self.cookie(r).encode(), shown)]
        return found[0] if found else None

    def cookie(self, role: Role) -> str:
        """Return the cookie of a role: the same for as long as its secret is."""
        return hmac.new(self.keys[role].encode(), role.encode(), hashlib.sha256).hexdigest()

    def role_of_certificate(self, shown: Mapping[str, Any] | None) -> Role | None:
        """Return the role of a certificate that a browser showed, as `getpeercert` tells it."""
        names = () if not shown else shown.get("subjectAltName", ())
        grants = [Grant.parse(value) for kind, value in names if kind == "URI"]
        roles = {grant.role for grant in grants if grant is not None and grant.cell == self.cell}
        return next((role for role in _RANK if role in roles), None)


def same_origin(origin: str | None, scheme: str, host: str) -> bool:
    """Return whether a request comes from the page that this console served to `host`."""
    if origin is None:
        return False
    try:
        parts = urlsplit(origin)
    except ValueError:  # no address: http://[::1
        return False
    return (parts.scheme, parts.netloc) == (scheme, host)


def tls_context(
    cell: str, identity: Identity | None, certificate: Path | None, key: Path | None
) -> ssl.SSLContext:
    """Return HTTPS, to which holders of the cell's certificates may log in with them.

    Without a `certificate` of its own the console shows the daemon's, where it runs beside it: an
    operator's is none that a browser believes of a server.

    Raises `ConfigError` where there is none, or one that cannot be used.
    """
    if certificate is None and identity is not None:
        certificate = identity.folder / f"{Role.DAEMON}-{cell}.crt"
        key = certificate.with_suffix(".key")
    if certificate is None or key is None or not (certificate.is_file() and key.is_file()):
        raise ConfigError(
            "--listen: beyond this machine the console speaks HTTPS: give --certificate and --key, "
            "or run it where the daemon's certificate is (telerobot certify)"
        )
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(certificate, key)
        if identity is not None:
            context.load_verify_locations(identity.folder / f"{AUTHORITY}.crt")
            context.verify_mode = ssl.CERT_OPTIONAL
    except (OSError, ssl.SSLError) as error:
        raise ConfigError(f"{certificate}: cannot be used for HTTPS: {error}") from None
    return context
