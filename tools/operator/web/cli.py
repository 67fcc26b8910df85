"""`telerobot console`, alone or beside a demo."""

import argparse
import asyncio
import atexit
import gc
import os
import shutil
import signal
import tempfile
import webbrowser
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any, Final

from aiohttp import web

from ....config.errors import ConfigError
from ....config.load import Cell
from ....drivers.network.identity import Identity, identity_of
from ....protocols.topics import Role
from ...client.operator import Connection
from ...host.address import cell_from
from .pages import PageHub
from .server import Access, Listen, SceneServer, Server, tls_context

KEYS: Final = "TELEROBOT_CONSOLE_KEYS"
"""Environment variable with the operators' and the observers' secret, for a console that is started
again: whoever had come in stays in."""

FETCHED: Final = Path(__file__).parent / "static/vendor/three.module.js"
"""One of the modules that `make page` fetches, and that every wheel has."""
KEEP_S: Final = 30.0  # a connection on which nothing is asked for is kept so long [s]


def run(args: argparse.Namespace) -> int:
    """Serve a cell's page until told to end. Raises `ConfigError`."""
    listen = listen_of(args)
    return asyncio.run(_live(cell_from(args), listen, args))


def listen_of(args: argparse.Namespace) -> Listen:
    """Return where to listen. Raises `ConfigError`, also where the page's modules are missing."""
    listen = Listen.parse(args.listen)
    if not FETCHED.is_file():
        raise ConfigError(f"console: {FETCHED.name} is not there: run `make page`")
    return listen


async def _live(cell: Cell, listen: Listen, args: argparse.Namespace) -> int:
    identity = identity_of(cell, Role.OPERATOR, "console")
    shown = None if identity is None else identity.folder / identity.certificate.name
    hub = PageHub(
        lambda: Connection(cell, name="console", identity=shown), cell.config.timing.period_s
    )

    def server(access: Access, secure: bool) -> SceneServer:
        return Server(cell, hub, access, listen, secure)

    try:
        return await serve_page(cell, listen, args, identity, server, hub.run)
    finally:
        hub.close()


async def serve_page(
    cell: Cell,
    listen: Listen,
    args: argparse.Namespace,
    identity: Identity | None,
    make: Callable[[Access, bool], SceneServer],
    work: Callable[[], Coroutine[Any, Any, Any]],
) -> int:
    """Serve a page, with work beside it, until told to end."""
    secure = listen.beyond or args.certificate is not None
    tls = tls_context(cell.config.name, identity, args.certificate, args.key) if secure else None
    access = _access(cell.config.name)
    server = make(access, secure)
    runner = web.AppRunner(
        server.application(), access_log=None, shutdown_timeout=1.0, keepalive_timeout=KEEP_S
    )
    await runner.setup()
    await web.TCPSite(runner, listen.host, listen.port, ssl_context=tls).start()
    assert runner.server is not None  # it is set up
    server.port = runner.addresses[0][1]
    address = _address(listen, server.port, secure)
    print(f"telerobot: console of {cell.config.name}: {address}/?key={access.keys[Role.OPERATOR]}")
    print(f"telerobot: to watch only: {address}/?key={access.keys[Role.OBSERVER]}", flush=True)
    if args.open:
        open_page(f"{address}/?key={access.keys[Role.OPERATOR]}")
    ended = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, ended.set)
    gc.collect()
    gc.freeze()  # a collection may take as long as a lease lasts
    working = asyncio.create_task(work())
    watching = asyncio.create_task(server.watch(runner.server))
    waiting = asyncio.create_task(ended.wait())
    try:
        done, _ = await asyncio.wait({working, waiting}, return_when=asyncio.FIRST_COMPLETED)
        if working in done:
            working.result()
    finally:
        working.cancel()
        watching.cancel()
        waiting.cancel()
        await runner.cleanup()
    return 0


def _access(cell: str) -> Access:
    given = os.environ.pop(KEYS, None)
    if given is None:
        return Access(cell)
    operators, _, observers = given.partition(",")
    try:
        return Access(cell, {Role.OPERATOR: operators, Role.OBSERVER: observers})
    except ConfigError as error:
        raise ConfigError(f"{KEYS}: {error}") from None


def open_page(address: str) -> None:
    """Open an address in a browser that everybody who lists processes must not read there.

    What is on its command line is a file that leads on, which nobody else may read.
    """
    folder = Path(tempfile.mkdtemp(prefix="telerobot-page-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    page = folder / "open.html"
    page.write_text(f'<meta charset="utf-8"><meta http-equiv="refresh" content="0;url={address}">')
    webbrowser.open(page.as_uri())


def _address(listen: Listen, port: int, secure: bool) -> str:
    """Return the page's address; one that is listened on everywhere is told as this machine's."""
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(listen.host, listen.host)
    shown = f"[{host}]" if ":" in host else host
    return f"{'https' if secure else 'http'}://{shown}:{port}"
