"""Certificate authority: signs names and roles, and knows which the network of a cell needs."""

import ipaddress
import json
import os
import re
import socket
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final, Self

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from ...config.errors import ConfigError
from ...config.load import Cell
from ...config.schema.network import SECURE
from ...protocols.roles import SERVERS, Grant
from ...protocols.topics import SENSORS, Role
from .access import enforced
from .certificates import AUTHORITY, certificate, issued, known, read
from .sessions import router_settings

# --- Certificate authority in a folder: signs names and roles -------------------------------------
#
# Elliptic keys on P-256. A private key is written once, readable by its owner alone, and never
# again.
YEARS_OF_AUTHORITY: Final = 10

CLOCKS_DIFFER: Final = timedelta(days=1)
"""A certificate holds from this long before now: the others' clocks may be behind."""


class Authority:
    """The one who signs. Raises `ConfigError` where it is only half there."""

    def __init__(self, folder: Path, key: ec.EllipticCurvePrivateKey, own: x509.Certificate):
        self.folder, self._key, self.own = folder, key, own

    @classmethod
    def of(cls, folder: Path) -> Self | None:
        """Return the authority of a folder; None where there is none yet."""
        crt, key = folder / f"{AUTHORITY}.crt", folder / f"{AUTHORITY}.key"
        if not crt.exists() and not key.exists():
            return None
        if not key.exists():
            raise ConfigError(f"{key}: missing: certificates are made where the authority's key is")
        own = read(crt)
        try:
            private = serialization.load_pem_private_key(key.read_bytes(), None)
        except OSError as error:
            raise ConfigError(f"{key}: cannot be read: {error.strerror}") from None
        except (ValueError, TypeError):
            raise ConfigError(f"{key}: no private key in PEM without a passphrase") from None
        if not isinstance(private, ec.EllipticCurvePrivateKey):
            raise ConfigError(f"{key}: no elliptic key, as telerobot certify makes")
        if private.public_key() != own.public_key():
            raise ConfigError(f"{key}: is not the key of {crt.name}")
        return cls(folder, private, own)

    @classmethod
    def make(cls, folder: Path, now: datetime) -> Self:
        """Return a new authority; its folder is made, and holds none yet."""
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        key = ec.generate_private_key(ec.SECP256R1())
        name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"telerobot {AUTHORITY}")])
        usage = x509.KeyUsage(
            digital_signature=False, content_commitment=False, key_encipherment=False,
            data_encipherment=False, key_agreement=False, key_cert_sign=True, crl_sign=True,
            encipher_only=False, decipher_only=False,
        )  # fmt: skip
        own = (
            _builder(
                name, name, key.public_key(), now, now + timedelta(days=365 * YEARS_OF_AUTHORITY)
            )
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(usage, critical=True)
            .sign(key, hashes.SHA256())
        )
        _write_key(folder / f"{AUTHORITY}.key", key)
        _write(folder / f"{AUTHORITY}.crt", own.public_bytes(serialization.Encoding.PEM))
        return cls(folder, key, own)

    def certify(
        self, name: str, grants: Iterable[Grant], hosts: Iterable[str], now: datetime, days: int
    ) -> Path:
        """Sign a certificate for a holder who has a key here, or had one before, or gets one now.

        `days` may not outlast the authority: the certificate ends with it then.
        """
        path = self.folder / f"{name}.crt"
        granted = tuple(sorted(grants))
        serves = any(grant.role in SERVERS for grant in granted)
        ends = min(now + timedelta(days=days), self.own.not_valid_after_utc)
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
        if serves:
            uses.append(ExtendedKeyUsageOID.SERVER_AUTH)
        others: list[x509.GeneralName] = [
            x509.UniformResourceIdentifier(grant.uri) for grant in granted
        ]
        others += [_general_name(host) for host in sorted(hosts)]
        signed = (
            _builder(subject, self.own.subject, self._public_key(path), now, ends)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
            .add_extension(x509.SubjectAlternativeName(others), critical=False)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(self._key.public_key()),
                critical=False,
            )
            .sign(self._key, hashes.SHA256())
        )
        _write(path, signed.public_bytes(serialization.Encoding.PEM))
        return path

    def _public_key(self, path: Path) -> ec.EllipticCurvePublicKey:
        """Return the public key of a certificate that is made anew, or of a key made now."""
        if path.exists():
            key = read(path).public_key()
            if isinstance(key, ec.EllipticCurvePublicKey):
                return key
            raise ConfigError(f"{path}: no elliptic key, as telerobot certify makes")
        private = ec.generate_private_key(ec.SECP256R1())
        _write_key(path.with_suffix(".key"), private)
        return private.public_key()


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePublicKey,
    now: datetime,
    ends: datetime,
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now.astimezone(UTC) - CLOCKS_DIFFER)
        .not_valid_after(ends)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _write_key(path: Path, key: ec.EllipticCurvePrivateKey) -> None:
    """Write a private key that nobody else may read, and that was not there before."""
    text = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise ConfigError(f"{path}: is there already, without its certificate") from None
    with os.fdopen(handle, "wb") as file:
        file.write(text)


def _write(path: Path, text: bytes) -> None:
    """Write a public file, whole or not at all."""
    new = path.with_name(f".{path.name}.new")
    new.write_bytes(text)
    new.replace(path)


# --- Zenoh configuration of a common router, from the certificates beside it ----------------------
LISTEN = f"{SECURE}[::]:7447"


def write_router(folder: Path, listen: str | None, name: str | None) -> Iterator[Path]:
    """Write `router-NAME.json5` for every router of a folder; yield what was written.

    It names files without their folder, so that it holds wherever the router starts beside them.
    The endpoint is that of `listen` for the router of a `name`, else the one that stands there.
    Raises `ConfigError`.
    """
    if listen is not None and not listen.startswith(SECURE):
        raise ConfigError(f"--listen: value '{listen}': a router's endpoint begins with {SECURE}")
    every, _ = known(folder)
    holders = {one.name: one.grants for one in every if not one.name.startswith(f"{Role.ROUTER}-")}
    cells = sorted({grant.cell for one in every for grant in one.grants})
    for router in sorted(one.name for one in every if one.name.startswith(f"{Role.ROUTER}-")):
        path = folder / f"{router}.json5"
        endpoint = _standing(path)
        if listen is not None and router == f"{Role.ROUTER}-{name}":
            endpoint = listen
        settings = router_settings(endpoint, Path(), router, cells)
        settings |= {"access_control": enforced(holders)}
        path.write_text(json.dumps(_nested(settings), indent=1) + "\n")
        yield path


def _standing(path: Path) -> str:
    """Return where a router listens whose file was written before."""
    if not path.exists():
        return LISTEN
    try:
        return str(json.loads(path.read_text())["listen"]["endpoints"][0])
    except (ValueError, LookupError, TypeError):
        raise ConfigError(f"{path}: is not as telerobot certify wrote it") from None


def _nested(settings: dict[str, object]) -> dict[str, Any]:
    """Return settings by path, `a/b`, as one nested dictionary."""
    nested: dict[str, Any] = {}
    for path, value in settings.items():
        inner = nested
        *above, last = path.split("/")
        for part in above:
            inner = inner.setdefault(part, {})
        inner[last] = value
    return nested


# --- Holders of certificates: those named on the command line, and those of every cell ------------
@dataclass(frozen=True)
class Holder:
    """Holder of a certificate, and its role."""

    name: str  # the common name
    grants: frozenset[Grant]
    hosts: frozenset[str] = frozenset()


SCAN: Final = "scan"  # `telerobot scan`, which asks for a certificate of that name
SCANS: Final = ("contour", "obstacle")  # keys that it puts on: a scanner tells of obstacles, too


def named(
    cells: Sequence[Cell],
    operators: Sequence[str],
    observers: Sequence[str],
    sensors: Sequence[tuple[str, tuple[str, ...]]],
    router: str | None,
    dialled: Iterable[str],
) -> list[Holder]:
    """Return whoever is named, and what every cell has: its daemon, its virtual hardware.

    `sensors` have the keys that they put on; `dialled` are hosts of daemons, or of the router.
    Without a name, one of each role that the cells can use.
    """
    names = [cell.config.name for cell in cells]
    here, given = frozenset(_own_hosts()), frozenset(dialled)
    made = []
    for cell, name in zip(cells, names, strict=True):
        # Behind a router a daemon is not dialled: the hosts are the router's.
        hosts = here | _listening(cell) | (frozenset() if router else given)
        made.append(Holder(f"{Role.DAEMON}-{name}", frozenset({Grant(name, Role.DAEMON)}), hosts))
        if cell.config.rig is not None:
            made += _virtual(name)
    if not (operators or observers or sensors or router):
        operators, observers = ["operator"], ["observer"]
        sensors = [(key, (f"sensor/{key}",)) for key in _used(cells)]
        if any(cell.config.scanner is not None for cell in cells):
            sensors.append((SCAN, tuple(f"sensor/{key}" for key in SCANS)))
    for role, each in ((Role.OPERATOR, operators), (Role.OBSERVER, observers)):
        made += [
            Holder(f"{role}-{who}", frozenset(Grant(cell, role) for cell in names)) for who in each
        ]
    for who, keys in sensors:
        grants = frozenset(Grant(cell, Role.SENSOR, key) for cell in names for key in keys)
        made.append(Holder(f"{Role.SENSOR}-{who}", grants))
    if router:
        grants = frozenset(Grant(cell, Role.ROUTER) for cell in names)
        made.append(Holder(f"{Role.ROUTER}-{router}", grants, here | given))
    return made


def standing(authority: Authority, cells: set[str], hosts: frozenset[str]) -> list[Holder]:
    """Return whom an authority certified for any of the cells; servers with more hosts."""
    paths = (path for path in authority.folder.glob("*.crt") if path.stem != AUTHORITY)
    every = [certificate(issued(path, authority.own)) for path in sorted(paths)]
    return [
        Holder(one.name, frozenset(one.grants), one.hosts | (hosts if one.serves else frozenset()))
        for one in every
        if cells.intersection(grant.cell for grant in one.grants)
    ]


def _virtual(cell: str) -> list[Holder]:
    """Return a cell's rig, whose sensors tell of frames, and the one who plays all parts there."""
    rig = {Grant(cell, Role.RIG), Grant(cell, Role.SENSOR, "sensor/frame")}
    judge = {Grant(cell, Role.JUDGE), Grant(cell, Role.OPERATOR)}
    judge |= {Grant(cell, Role.SENSOR, topic.key) for topic in SENSORS}
    return [
        Holder(f"{Role.RIG}-{cell}", frozenset(rig)),
        Holder(f"{Role.JUDGE}-{cell}", frozenset(judge)),
    ]


def _used(cells: Sequence[Cell]) -> list[str]:
    """Return the keys on which sensors of these cells put."""
    used = {
        "vision": any(cell.cameras for cell in cells),
        "obstacle": any(cell.config.keeps_clear for cell in cells),
        "frame": any(cell.config.frames.moving for cell in cells),
    }
    return [key for key in sensor_keys() if used.get(key)]


def _own_hosts() -> tuple[str, ...]:
    host = socket.gethostname().lower()
    return ("localhost", "127.0.0.1", "::1", *([host] if is_host(host) else []))


def _listening(cell: Cell) -> frozenset[str]:
    """Return the host at which a cell's daemon listens, where it is one to dial."""
    host = cell.config.zenoh.listen.partition("/")[2].rpartition(":")[0].strip("[]")
    return frozenset() if host in ("0.0.0.0", "::") or not is_host(host) else frozenset({host})


def is_host(host: str) -> bool:
    """Return whether a text is a host's name, in small letters, or its address."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        label = r"[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?"
        return len(host) <= 253 and re.fullmatch(rf"{label}(\.{label})*", host) is not None
    return True


def sensor_keys() -> list[str]:
    """Return the keys that sensors put on, by their last part."""
    return [topic.key.removeprefix("sensor/") for topic in SENSORS]
