"""The console's HTTP: one page, its modules, one WebSocket for each; safe headers on everything."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Final

from aiohttp import WSMsgType, web

from ....config.load import Cell
from ....protocols.topics import Role
from .access import DEADLINE_S, Access, Doorkeeper, Listen, same_origin
from .catalogue import catalogue
from .login import LOGIN, welcome
from .pages.hub import PageHub
from .pages.page import Page
from .scene import Scene, scene_of

STATIC: Final = Path(__file__).resolve().parent / "static"
ROLE: Final = web.RequestKey("role", Role)
LARGEST: Final = 65536
"""Longest message that is read from a page [B]."""
SWEEP_S: Final = 0.5
"""Connections are looked through every [s]."""

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
        self.port = listen.port
        """The port that is listened on, once it is."""
        self.door = Doorkeeper()

    def application(self) -> web.Application:
        """Return the application."""

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
        response = web.Response(text=welcome(), content_type="text/html")
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
