"""Certificates: what one says of its holder, how long it holds, and who issued it."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from ...config.errors import ConfigError
from ...protocols.roles import SERVERS, Grant, Rights, rights

AUTHORITY: Final = "authority"
"""Stem of the authority's files."""

WARN_BEFORE: Final = timedelta(days=30)
"""A certificate that ends within this time is warned of."""


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
        """Rights of the holder."""
        return rights(self.grants, self.name)

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


def issued(path: Path, authority: x509.Certificate) -> x509.Certificate:
    """Return a certificate's file, parsed. Raises `ConfigError` for one of another authority."""
    parsed = read(path)
    try:
        parsed.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature):
        raise ConfigError(f"{path}: not issued by the {AUTHORITY}.crt beside it") from None
    return parsed


def match_key(path: Path, parsed: x509.Certificate) -> None:
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
