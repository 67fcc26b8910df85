"""`telerobot console`: a cell's page; of a recorded run, the page with its time line."""

import argparse
import asyncio
from pathlib import Path
from typing import Final

from ...operator.web import cli as live
from ...operator.web.access import Access, Listen
from .server import PlaybackServer
from .timeline import Timeline

RECORDING: Final = ".mcap"
"""End of the name of a recorded run."""


def run(args: argparse.Namespace) -> int:
    """Serve a page until told to end. Raises `ConfigError`, `RecordError`, `OSError`."""
    file = Path(args.cell)
    if file.suffix != RECORDING:
        return live.run(args)
    listen = live.listen_of(args)
    timeline = Timeline(file)
    return asyncio.run(_play(timeline, listen, args))


async def _play(timeline: Timeline, listen: Listen, args: argparse.Namespace) -> int:
    def server(access: Access, secure: bool) -> PlaybackServer:
        return PlaybackServer(timeline, access, listen, secure)

    return await live.serve_page(timeline.cell, listen, args, None, server, asyncio.Event().wait)
