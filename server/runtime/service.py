"""Words to the service manager that started the daemon: sd_notify, where there is one to hear."""

import contextlib
import os
import socket
from collections.abc import Mapping


def notify(words: str, environment: Mapping[str, str] = os.environ) -> None:
    """Send `READY=1` and the like to systemd's socket; without one, do nothing."""
    address = environment.get("NOTIFY_SOCKET", "")
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    with (
        contextlib.suppress(OSError),  # a manager that has gone is told nothing
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as heard,
    ):
        heard.sendto(words.encode(), address)
