"""Where a process finds the certificate that it shows, and whom it believes.

A folder holds the authority's certificate, `authority.crt`, and for each holder `ROLE-NAME.crt`
with the common name `ROLE-NAME`, and the private `ROLE-NAME.key` of those who work there.
"""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from ...config.errors import ConfigError
from ...config.load import Cell
from ...config.schema.network import SECURE
from ...protocols.roles import SERVERS, Grant
from ...protocols.topics import Role
from .certificates import AUTHORITY, Certificate, certificate, issued, match_key, read

_SUFFICE: Final = {Role.OPERATOR: {Role.OPERATOR, Role.OBSERVER, Role.JUDGE}}
"""Who may take part as what; an observer's program is an operator's that may only listen."""


@dataclass(frozen=True)
class Identity:
    """Identity of a process: a certificate of its folder's authority, and its key."""

    folder: Path
    certificate: Certificate

    @property
    def certificate_file(self) -> Path:
        """The certificate."""
        return self.folder / f"{self.certificate.name}.crt"

    @property
    def key_file(self) -> Path:
        """The private key."""
        return self.folder / f"{self.certificate.name}.key"


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


def servers(identity: Identity, cell: str) -> set[str]:
    """Return the common names under which a cell's daemon may be found: its own, or a router's."""
    routers = (path.stem for path in identity.folder.glob(f"{Role.ROUTER}-*.crt"))
    return {f"{Role.DAEMON}-{cell}", *routers}


def _found(where: Path, role: Role, name: str) -> Identity:
    """Return the identity of a stem; in a folder of a role and name, or the role's only one."""
    if where.is_dir():
        folder, stem = where, f"{role}-{name}"
        others = sorted(path.stem for path in folder.glob(f"{role}-*.key"))
        if f"{role}-{name}" not in others and len(others) == 1 and role not in SERVERS:
            stem = others[0]
    else:
        folder, stem = where.parent, where.name.removesuffix(".crt")
    path = folder / f"{stem}.crt"
    if not path.is_file():
        missing = path if where.is_dir() else where
        raise ConfigError(
            f"{missing}: not there: telerobot certify makes it; or name yours with --identity"
        )
    parsed = issued(path, read(folder / f"{AUTHORITY}.crt"))
    found = Identity(folder, certificate(parsed))
    now = datetime.now(UTC)
    if not found.certificate.holds(now):
        raise ConfigError(f"{path}: {found.certificate.trouble(now)}")
    if found.certificate.name != stem:
        raise ConfigError(f"{path}: is the certificate of {found.certificate.name}")
    match_key(found.key_file, parsed)
    return found
