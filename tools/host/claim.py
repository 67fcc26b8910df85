"""Endpoint and port of a demo: the cell's own, or another one, and why."""

import errno
import socket
from contextlib import ExitStack

from ...config.load import Cell
from ...config.schema.network import SECURE, beyond_loopback


class Claims:
    """Ports of this machine that this process has claimed, until it ends.

    Two demos that start at once would both find a port free; a name in the abstract namespace is
    one's at once.
    """

    def __init__(self) -> None:
        self._names = ExitStack()

    def take(self, port: int) -> str:
        """Claim a port of 127.0.0.1; return in words why that cannot be, or nothing."""
        name = socket.socket(socket.AF_UNIX)
        try:
            name.bind(f"\0telerobot-{port}")
        except OSError:
            name.close()
            return "another demo has it"
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except OSError as error:
                name.close()
                return "it is in use" if error.errno == errno.EADDRINUSE else str(error.strerror)
        self._names.enter_context(name)
        return ""


def own_endpoint(cell: Cell, claims: Claims) -> tuple[str | None, str]:
    """Return the cell's own endpoint if a demo may listen there; else None, and why not."""
    zenoh = cell.config.zenoh
    if zenoh.router is not None:
        return None, f"{zenoh.router} is a common router"
    secured = zenoh.security.directory is not None
    if beyond_loopback(zenoh.listen) or secured != zenoh.listen.startswith(SECURE):
        return None, f"{zenoh.listen} is not for this machine alone"
    port = zenoh.listen.rpartition(":")[2]
    if not port.isdecimal():
        return None, f"{zenoh.listen} names no port"
    why = claims.take(int(port))
    return (None, f"{zenoh.listen}: {why}") if why else (zenoh.listen, "")
