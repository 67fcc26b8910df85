"""The console's server: pages, their files, and who may have them."""

import asyncio
import hashlib
import hmac
import ipaddress
import re
import secrets
import ssl
from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

from aiohttp import WSMsgType, web

from ....config.errors import ConfigError
from ....config.load import Cell
from ....config.schema.sources import SourcesSection
from ....drivers.network.certificates import AUTHORITY
from ....drivers.network.identity import Identity
from ....protocols import topics as t
from ....protocols.roles import Grant
from ....protocols.topics import Role
from .pages import Page, PageHub
from .scene import Scene, scene_of

# --- Who may see the page, and who may drive through it: secrets, cookies, certificates, origins
#
# Two secrets are drawn at start: whoever knows the operators' may drive, whoever knows the
# observers' may watch (and stop the arm). One stands in the address of the first visit; from
# then on a cookie made from it does. Beyond this machine there is HTTPS, and a browser that
# shows a certificate of `[zenoh.security]` has the role that the certificate grants.
_RANK: Final = (Role.OPERATOR, Role.OBSERVER)  # roles of a page, the one that may do more first


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


SHORTEST: Final = 16  # a secret of fewer characters is refused: it could be guessed [1]

DEADLINE_S: Final = 10.0  # a connection, or a form, that is not whole by then is given up [s]
MOST: Final = 64  # connections from one address, or one network of IPv6 (/64), at a time [1]


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
        return self._role_of(key, self.keys.__getitem__)

    def role_of_cookie(self, cookie: str) -> Role | None:
        """Return the role that a cookie gives; None for none of this console's."""
        return self._role_of(cookie, self.cookie)

    def _role_of(self, shown: str, wanted: Callable[[Role], str]) -> Role | None:
        """Return the first role that is shown what it wants; all are compared, for equal times."""
        known = shown.encode(errors="replace")
        found = [r for r in _RANK if hmac.compare_digest(wanted(r).encode(), known)]
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


# --- The two small pages before the page: who asks for the secret, and who leads on ---------------
STATIC: Final = Path(__file__).resolve().parent / "static"
LOGIN: Final = (STATIC / "login.html").read_text(encoding="utf-8")
WELCOME: Final = (STATIC / "welcome.html").read_text(encoding="utf-8")
"""Leads on to the address without the secret: a page of this origin, not a redirection, so that a
cookie for this site alone goes with it."""


# --- All that an operator may send, for the page's settings: from the one table of topics ---------
def catalogue(cell: Cell) -> dict[str, Any]:
    """Return each command and request with the schema of its fields, and gains' units, as JSON."""
    return {
        "cell": cell.config.name,
        "gain_units": _gain_units(),
        "topics": [
            {
                "key": topic.key,
                "life": topic.life.name.lower(),
                "answered": topic.flow.asks,
                "title": (topic.message.__doc__ or "").strip().partition("\n")[0],
                "schema": topic.message.model_json_schema(),
            }
            for topic in (*t.COMMANDS, *t.REQUESTS)
        ],
    }


def _gain_units() -> dict[str, str]:
    """Return the unit of each source's gain, as its section states it: linear, angular."""
    found = {}
    for source, section in SourcesSection.model_fields.items():
        gain = getattr(section.annotation, "model_fields", {}).get("gain")
        unit = re.search(r"\[([^\]]+)\]$", "" if gain is None else gain.description or "")
        if unit is not None:
            found[source] = unit[1]
    return found


# --- The console's HTTP: one page, its modules, one WebSocket for each; safe headers on everything
ROLE: Final = web.RequestKey("role", Role)
LARGEST: Final = 65536  # longest message that is read from a page [B]
SWEEP_S: Final = 0.5  # connections are looked through every [s]

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class SceneServer:
    """Serves a page with one cell's scene to those who may see it."""

    INDEX = "index.html"

    def __init__(
        self,
        cell: Cell,
        access: Access,
        listen: Listen,
        secure: bool,
        drawn: Scene | None = None,
    ) -> None:
        """Build it; it draws what is `drawn`, or what the cell's files hold now."""
        self._cell, self._access, self._listen = cell, access, listen
        self._drawn: asyncio.Future[Scene] | None = None
        self._recorded = drawn
        self._scheme = "https" if secure else "http"
        self.port = listen.port  # the port that is listened on, once it is
        self.door = Doorkeeper()

    def application(self) -> web.Application:

        @web.middleware
        async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
            return await self._guard(request, handler)

        app = web.Application(middlewares=[guard], client_max_size=LARGEST)
        app.router.add_get("/", self._index)
        app.router.add_post("/login", self._login)
        app.router.add_get("/scene.json", self._scene)
        app.router.add_get(r"/meshes/{number:\d{1,6}}.glb", self._mesh)
        self._add_routes(app.router)
        app.router.add_static("/", STATIC)
        return app

    def _add_routes(self, router: web.UrlDispatcher) -> None:
        """Add what else this page asks for."""

    async def watch(self, server: web.Server) -> None:
        """Look through the connections again and again."""
        clock = asyncio.get_running_loop().time
        while True:
            open_ = (each.transport for each in server.connections)
            self.door.sweep([each for each in open_ if each is not None], clock())
            await asyncio.sleep(SWEEP_S)

    # --- who comes in ------------------------------------------------------------------------

    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Let in who may see the page; every answer has the headers of `_seal`."""
        self.door.served(request.transport)
        names = self._listen.names(self.port)
        if names and request.host not in names:
            return self._seal(request, web.Response(status=421, text="not this host\n"))
        if request.path == "/login" or (request.path == "/" and "key" in request.query):
            return self._seal(request, await handler(request))
        role = self._role(request)
        if role is None:
            page = web.Response(status=401, text=LOGIN, content_type="text/html")
            return self._seal(request, page)
        request[ROLE] = role
        try:
            return self._seal(request, await handler(request))
        except web.HTTPException as refused:
            plain = web.Response(status=refused.status, text=f"{refused.reason}\n")
            return self._seal(request, plain)

    def _role(self, request: web.Request) -> Role | None:
        certified = self._access.role_of_certificate(request.get_extra_info("peercert"))
        cookie = request.cookies.get(self._cookie, "")
        return certified or self._access.role_of_cookie(cookie)

    @property
    def _cookie(self) -> str:
        return f"telerobot-{self.port}"  # cookies do not tell ports apart

    def _seal(self, request: web.Request, response: web.StreamResponse) -> web.StreamResponse:
        if response.prepared:
            return response
        socket = f"{'wss' if self._scheme == 'https' else 'ws'}://{request.host}"
        response.headers.update(
            {
                "Content-Security-Policy": "default-src 'none'; script-src 'self'; "
                "style-src 'self'; img-src 'self' data: blob:; font-src 'self'; "
                f"connect-src 'self' {socket}; base-uri 'none'; form-action 'self'; "
                "frame-ancestors 'none'",
                "X-Content-Type-Options": "nosniff",
                "Referrer-Policy": "no-referrer",
                "Cross-Origin-Opener-Policy": "same-origin",
                "Cross-Origin-Resource-Policy": "same-origin",
                "Cache-Control": "no-cache",
            }
        )
        return response

    def _admit(self, key: str) -> web.Response:
        """Return the page that sets the cookie of a secret and leads on, or asks again."""
        role = self._access.role_of_key(key)
        if role is None:
            return web.Response(status=401, text=LOGIN, content_type="text/html")
        response = web.Response(text=WELCOME, content_type="text/html")
        response.set_cookie(
            self._cookie,
            self._access.cookie(role),
            httponly=True,
            secure=self._scheme == "https",
            samesite="Strict",
        )
        return response

    # --- what is served ----------------------------------------------------------------------

    async def _index(self, request: web.Request) -> web.StreamResponse:
        if "key" in request.query:
            return self._admit(request.query["key"])
        return web.FileResponse(STATIC / self.INDEX)

    async def _login(self, request: web.Request) -> web.StreamResponse:
        if not same_origin(request.headers.get("Origin"), self._scheme, request.host):
            return web.Response(status=403, text="another origin\n")
        try:
            async with asyncio.timeout(DEADLINE_S):
                form = await request.post()
        except TimeoutError:
            return web.Response(status=408, text="the form did not come\n")
        return self._admit(str(form.get("key", "")).strip())

    async def _scene(self, _request: web.Request) -> web.StreamResponse:
        return web.json_response((await self._scene_of_cell()).description)

    async def _mesh(self, request: web.Request) -> web.StreamResponse:
        data = (await self._scene_of_cell()).files.get(request.path)
        if data is None:
            raise web.HTTPNotFound
        return web.Response(body=data, content_type="model/gltf-binary")

    async def _scene_of_cell(self) -> Scene:
        """Return the scene; meshes are read once, beside what is served meanwhile."""
        if self._recorded is not None:
            return self._recorded
        if self._drawn is None:
            self._drawn = asyncio.ensure_future(asyncio.to_thread(scene_of, self._cell))
        return await asyncio.shield(self._drawn)


class Server(SceneServer):
    """Serves the operator's page of one cell."""

    def __init__(
        self, cell: Cell, hub: PageHub, access: Access, listen: Listen, secure: bool
    ) -> None:
        super().__init__(cell, access, listen, secure)
        self._hub = hub
        self._visitors = 0

    def _add_routes(self, router: web.UrlDispatcher) -> None:
        router.add_get("/ws", self._socket)
        router.add_get("/catalogue.json", self._catalogue)

    async def _catalogue(self, _request: web.Request) -> web.StreamResponse:
        return web.json_response(catalogue(self._cell))

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        if not same_origin(request.headers.get("Origin"), self._scheme, request.host):
            return web.Response(status=403, text="another origin\n")
        socket = web.WebSocketResponse(max_msg_size=LARGEST, heartbeat=5.0, compress=False)
        await socket.prepare(request)
        self._visitors += 1
        name = request.query.get("name", "").strip()[:48] or f"page {self._visitors}"
        role: Role = request[ROLE]
        cameras = frozenset(camera.name for camera in self._cell.cameras)
        page = self._hub.open_page(name, role, self._cell.config.name, cameras)
        writer = asyncio.create_task(_write(page, socket))
        try:
            async for message in socket:
                if message.type is not WSMsgType.TEXT:
                    break
                page.take(message.data)
                if page.dismissed:
                    break
        finally:
            writer.cancel()
            self._hub.close_page(page)
            await socket.close(message=page.dismissed.encode())
        return socket


async def _write(page: Page, socket: web.WebSocketResponse) -> None:
    """Send a page what it is told: messages in order, of states the newest only, frames last."""
    while not page.dismissed:
        await page.wake.wait()
        page.wake.clear()
        while not page.outbox.empty():
            await socket.send_str(page.outbox.get_nowait())
        for kind in tuple(page.newest):
            await socket.send_str(page.newest.pop(kind))
        if (frame := page.next_frame()) is not None:
            page.wake.set()  # what else there is comes before the frame after it
            await socket.send_bytes(frame)
    await socket.close(message=page.dismissed.encode())
