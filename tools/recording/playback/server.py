"""The HTTP of a recorded run: its page, its scene, and its pieces; nothing can be sent."""

from aiohttp import web

from ...operator.web.access import Access, Listen
from ...operator.web.server import SceneServer
from .timeline import Timeline


class PlaybackServer(SceneServer):
    """Serves the page of one recorded run, to who knows either secret."""

    INDEX = "playback.html"

    def __init__(self, timeline: Timeline, access: Access, listen: Listen, secure: bool) -> None:
        super().__init__(timeline.cell, access, listen, secure, timeline.scene)
        self._timeline = timeline

    def _add_routes(self, router: web.UrlDispatcher) -> None:
        router.add_get("/run.json", self._run)
        router.add_get(r"/pieces/{number:\d{1,9}}.json", self._piece)

    async def _run(self, _request: web.Request) -> web.StreamResponse:
        return web.json_response(self._timeline.summary)

    async def _piece(self, request: web.Request) -> web.StreamResponse:
        piece = self._timeline.piece(int(request.match_info["number"]))
        if piece is None:
            raise web.HTTPNotFound
        return web.Response(body=piece, content_type="application/json")
