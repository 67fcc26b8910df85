"""Zenoh configuration of a common router, from the certificates beside it."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ...config.load import ConfigError
from ...config.schema.network import SECURE
from ...drivers.network.access import enforced
from ...drivers.network.certificates import known
from ...drivers.network.sessions import router_settings
from ...protocols.topics import Role

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
