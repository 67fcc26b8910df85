"""The page of a demo: its address, or in words why there is none."""

import os
import secrets
import socket
from importlib.util import find_spec

from ...host.claim import Claims
from ...host.local_plant import LocalPlant, free_port

PORT = 8080
"""The page's port, if it is free."""


def start_page(plant: LocalPlant, claims: Claims) -> list[str]:
    """Start the console of a demo; return what to tell about it."""
    if find_spec("aiohttp") is None:
        return ["no page in the browser: pip install 'telerobot[console]'"]
    from .cli import KEYS, open_page
    from .vendor.fetch import missing

    if missing():
        return ["no page in the browser: its JavaScript is not there (make venv fetches it)"]
    taken = claims.take(PORT)
    port = free_port(socket.SOCK_STREAM) if taken else PORT
    operators, observers = secrets.token_urlsafe(24), secrets.token_urlsafe(24)
    plant.start_console([f"--listen=127.0.0.1:{port}"], {KEYS: f"{operators},{observers}"})
    address = f"http://127.0.0.1:{port}/?key={operators}"
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        open_page(address)
    other = f" (port {PORT}: {taken})" if taken else ""
    return [
        f"the page: {address}{other}",
        f"to watch only: http://127.0.0.1:{port}/?key={observers}",
    ]
