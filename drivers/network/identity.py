"""Certificates: what one says of its holder, where a process finds its own, and whom it knows.

A folder holds the authority's certificate, `authority.crt`, and for each holder `ROLE-NAME.crt`
with the common name `ROLE-NAME`, and the private `ROLE-NAME.key` of those who work there.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from ...config.errors import ConfigError
from ...config.load import Cell
from ...config.security import SECURE
from ...protocols.roles import SERVERS, Grant, Rights, rights
from ...protocols.topics import Role

AUTHORITY: Final = "authority"
"""Stem of the authority's files."""

WARN_BEFORE: Final = timedelta(days=30)
"""A certificate that ends within this time is warned of."""


_SUFFICE: Final = {Role.OPERATOR: {Role.OPERATOR, Role.OBSERVER, Role.JUDGE}}
"""Who may take part as what; an observer's program is an operator's that may only listen."""


@dataclass(frozen=True)
class Certificate:
    """A certificate's holder by common name, what it grants, and how long it holds."""

    name: str
    grants: tuple[Grant, ...]
    hosts: frozenset[str]
    """Names and addresses under which a server may be dialled."""
    begins: datetime
    ends: datetime

    @property
    def rights(self) -> Rights:
        """What the holder may do."""
        return rights(self.grants)

    @property
    def serves(self) -> bool:
        """True for one that others dial."""
        return any(grant.role in SERVERS for grant in self.grants)

    def trouble(self, now: datetime) -> str:
        """Return in words that it does not hold, or not for long; empty if it holds."""
        day = f"{self.ends:%Y-%m-%d}"
        if now > self.ends:
            return f"{self.name}: expired on {day}"
        if now < self.begins:
            return (
                f"{self.name}: holds from {self.begins:%Y-%m-%d %H:%M} UTC on; is the clock right?"
            )
        left = (self.ends - now).days
        return (
            f"{self.name}: expires on {day}, in {left} days"
            if now > self.ends - WARN_BEFORE
            else ""
        )

    def holds(self, now: datetime) -> bool:
        """Return whether it can be shown now."""
        return self.begins <= now <= self.ends


@dataclass(frozen=True)
class Identity:
    """What a process shows of itself: a certificate of its folder's authority, and its key."""

    folder: Path
    certificate: Certificate

    @property
    def authority_file(self) -> Path:
        """The authority's certificate."""
        return self.folder / f"{AUTHORITY}.crt"

    @property
    def certificate_file(self) -> Path:
        """The certificate."""
        return self.folder / f"{self.certificate.name}.crt"

    @property
    def key_file(self) -> Path:
        """The private key."""
        return self.folder / f"{self.certificate.name}.key"

    def troubles(self, now: datetime) -> list[str]:
        """Return in words which certificates end soon: this one, and the authority's."""
        authority = certificate(read(self.authority_file))
        return [t for t in (self.certificate.trouble(now), authority.trouble(now)) if t]


def identity_of(cell: Cell, role: Role, name: str, topic: str = "") -> Identity | None:
    """Return what a process of a cell shows of itself; None in a cell without certificates.

    A sensor says on which `topic` it puts.

    Raises `ConfigError` where it is not found, does not hold, is another role's or cell's, or does
    not fit to the endpoint.
    """
    zenoh = cell.config.zenoh
    where, secure = zenoh.security.directory, zenoh.endpoint.startswith(SECURE)
    key = f"{cell.path}: zenoh.{zenoh.key}: value '{zenoh.endpoint}'"
    if where is None:
        if secure:
            raise ConfigError(f"{key}: needs certificates: zenoh.security.directory, --identity")
        return None
    if not secure:
        raise ConfigError(f"{key}: with certificates the endpoint begins with {SECURE}")
    if "#" in zenoh.endpoint or "?" in zenoh.endpoint:
        raise ConfigError(f"{key}: with certificates the endpoint takes no options of its own")
    found = _found(cell.path.parent / where, role, name)
    grants = [g for g in found.certificate.grants if g.cell == cell.config.name]
    if not any(g.role in _SUFFICE.get(role, {role}) and g.topic in ("", topic) for g in grants):
        told = ", ".join(g.uri for g in found.certificate.grants) or "nothing"
        needed = Grant(cell.config.name, role, topic).uri
        raise ConfigError(f"{found.certificate_file}: does not certify {needed}, but {told}")
    if zenoh.router is not None and not any(found.folder.glob(f"{Role.ROUTER}-*.crt")):
        raise ConfigError(f"{found.folder}: no {Role.ROUTER}-NAME.crt there of the common router")
    return found


def known(folder: Path) -> tuple[list[Certificate], list[str]]:
    """Return the certificates that lie in a folder, and in words those that cannot be used."""
    authority = read(folder / f"{AUTHORITY}.crt")
    now = datetime.now(UTC)
    found = []
    complaints = [t for t in (certificate(authority).trouble(now),) if t]
    for path in sorted(folder.glob("*.crt")):
        if path.stem == AUTHORITY:
            continue
        try:
            one = certificate(issued(path, authority))
        except ConfigError as error:
            complaints.append(str(error))
            continue
        if one.trouble(now):
            complaints.append(one.trouble(now))
        if one.holds(now):
            found.append(one)
    return found, complaints


def servers(identity: Identity, cell: str) -> set[str]:
    """Return the common names under which a cell's daemon may be found: its own, or a router's."""
    routers = (path.stem for path in identity.folder.glob(f"{Role.ROUTER}-*.crt"))
    return {f"{Role.DAEMON}-{cell}", *routers}


def read(path: Path) -> x509.Certificate:
    """Return a certificate's file, parsed. Raises `ConfigError`."""
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError:
        raise ConfigError(f"{path}: no certificate in PEM") from None


def certificate(parsed: x509.Certificate) -> Certificate:
    """Return what a certificate says."""
    names = parsed.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
    try:
        other = parsed.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        other = x509.SubjectAlternativeName([])
    uris = other.get_values_for_type(x509.UniformResourceIdentifier)
    addresses = other.get_values_for_type(x509.IPAddress)
    grants = (Grant.parse(uri) for uri in uris)
    return Certificate(
        str(names[0].value) if names else "",
        tuple(grant for grant in grants if grant is not None),
        frozenset((*other.get_values_for_type(x509.DNSName), *map(str, addresses))),
        parsed.not_valid_before_utc,
        parsed.not_valid_after_utc,
    )


def _found(where: Path, role: Role, name: str) -> Identity:
    """Return the identity of a stem; in a folder of a role and name, or the role's only one."""
    folder, stem = (where, f"{role}-{name}") if where.is_dir() else (where.parent, where.name)
    if not (folder / f"{stem}.key").is_file() and where.is_dir():
        others = sorted(path.stem for path in where.glob(f"{role}-*.key"))
        if len(others) == 1 and role not in SERVERS:
            stem = others[0]
    authority = read(folder / f"{AUTHORITY}.crt")
    path = folder / f"{stem}.crt"
    if not path.is_file():
        raise ConfigError(
            f"{path}: not there: telerobot certify makes it; or name yours with --identity"
        )
    parsed = issued(path, authority)
    found = Identity(folder, certificate(parsed))
    now = datetime.now(UTC)
    if not found.certificate.holds(now):
        raise ConfigError(f"{path}: {found.certificate.trouble(now)}")
    if found.certificate.name != stem:
        raise ConfigError(f"{path}: is the certificate of {found.certificate.name}")
    _match(found.key_file, parsed)
    return found


def issued(path: Path, authority: x509.Certificate) -> x509.Certificate:
    """Return a certificate's file, parsed. Raises `ConfigError` for one of another authority."""
    parsed = read(path)
    try:
        parsed.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature):
        raise ConfigError(f"{path}: not issued by the {AUTHORITY}.crt beside it") from None
    return parsed


def _match(path: Path, parsed: x509.Certificate) -> None:
    """Raise `ConfigError` unless a file holds the private key of a certificate."""
    try:
        key = load_pem_private_key(path.read_bytes(), None)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, TypeError):
        raise ConfigError(f"{path}: no private key in PEM without a passphrase") from None
    if key.public_key() != parsed.public_key():
        raise ConfigError(f"{path}: is not the key of {path.with_suffix('.crt').name}")


def in_cell(every: Iterable[Certificate], cell: str) -> dict[str, tuple[Grant, ...]]:
    """Return what certificates grant in one cell, by common name; servers are nobody's guests."""
    return {
        one.name: tuple(g for g in one.grants if g.cell == cell)
        for one in every
        if not one.serves and any(g.cell == cell for g in one.grants)
    }
