"""Pictures of shipped cells as the console shows them.

`python -m laboratory.equipment.pictures` simulates each cell under its script to a moment that
shows what it is for, and lets the page's own scene draw it in a headless Chromium. Needs Chromium,
Playwright, and what `make page` fetches.
"""

import argparse
import json
import sys
import threading
from collections.abc import Mapping
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlencode, urlsplit

from playwright.sync_api import Browser, sync_playwright
from telerobot.config.load import Cell, ConfigError, load_cell, shipped
from telerobot.tools.host.local_plant import ChildDied
from telerobot.tools.operator.web.scene import scene_of

from .moments import MOMENTS, Moment, Run, run_of
from .whole import take_whole

ROOT: Final = Path(__file__).resolve().parents[3]
STATIC: Final = ROOT / "tools/operator/web/static"
PICTURES: Final = ROOT / "config/pictures/console"
FLAGS: Final = [
    "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-accelerated-2d-canvas",
]  # fmt: skip
"""Chromium without a graphics processor, and in a container; plots wait for no scene."""
SIZE: Final = (800, 500)
PATIENCE_MS: Final = 240_000
"""Without a graphics processor a picture may take long."""
COLOURS: Final = (256, 128, 64, 32)
LARGEST: Final = 100_000
"""A picture is smaller than this, with the most of those colours [B]."""
LARGEST_WHOLE: Final = 300_000
"""... and one of the whole page than this [B]."""


class _Handler(SimpleHTTPRequestHandler):
    """Serves the page's modules, one description and one run."""

    def __init__(self, *args: Any, told: Mapping[str, bytes]) -> None:
        self._told = told
        super().__init__(*args)

    def do_GET(self) -> None:
        path = urlsplit(self.path).path
        file = STATIC / path.removeprefix("/")
        body = self._told.get(path) or (file.read_bytes() if file.is_file() else None)
        self.send_response(404 if body is None else 200)
        kind = "text/html" if path == "/" else self.guess_type(path)
        self.send_header("Content-Type", kind)
        self.end_headers()
        self.wfile.write(body or b"")

    def log_message(self, *args: Any) -> None:
        """Say nothing: what is missing shows in the page's own messages."""


def take(
    browser: Browser, cell: Cell, moment: Moment, picture: Path, run: Run | None = None
) -> list[str]:
    """Write the picture of a cell; return what the page complained of.

    Of a `run` that there is, else of its own to that moment.
    """
    scene = scene_of(cell)
    told = {
        **scene.files,
        "/description.json": json.dumps(scene.description).encode(),
        "/run.json": (run or run_of(cell, moment)).json(),
        "/": (STATIC / "scene" / "still.html").read_bytes(),
    }
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Handler, told=told))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    complaints: list[str] = []
    page = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
    try:
        page.set_default_timeout(PATIENCE_MS)
        page.on("console", lambda m: complaints.append(m.text) if m.type != "log" else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        port = server.server_address[1]
        asked = {"view": moment.view, "theme": moment.theme, "handle": moment.handle or ""}
        page.goto(f"http://127.0.0.1:{port}/?{urlencode(asked)}")
        page.wait_for_selector("body[data-ready]")
        page.screenshot(path=str(picture))
    finally:
        page.close()
        server.shutdown()
        server.server_close()
    _shrink(picture)
    return complaints


def _shrink(picture: Path, largest: int = LARGEST) -> None:
    """Write a picture with as many colours as fit into `largest`, where Pillow is there."""
    try:
        from PIL import Image
    except ImportError:
        return
    with Image.open(picture) as image:
        whole = image.convert("RGB")
    for colours in COLOURS:
        palette = whole.quantize(colours, method=Image.Quantize.FASTOCTREE)
        whole.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG).save(
            picture, optimize=True
        )
        if picture.stat().st_size < largest:
            return


def main(arguments: list[str] | None = None) -> int:
    """Take the pictures that are asked for; all shipped cells' by default."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("cells", metavar="CELL", nargs="*", help="all shipped cells by default")
    parser.add_argument("--to", metavar="FOLDER", type=Path, default=PICTURES)
    parser.add_argument(
        "--whole", metavar="FILE", type=Path, help="the whole page at work, of one cell"
    )
    parser.add_argument("--theme", choices=("dark", "light"))
    parser.add_argument("--view", help="home, front, side or top")
    parser.add_argument("--handle", choices=("translate", "rotate"))
    parser.add_argument("--script")
    parser.add_argument("--at", metavar="SECONDS", type=float, help="moment of the run [s]")
    parser.add_argument("--chromium", metavar="FILE", default="/usr/bin/chromium")
    args = parser.parse_args(arguments)
    given = {
        "script": args.script, "time_s": args.at, "view": args.view, "theme": args.theme,
        "handle": args.handle,
    }  # fmt: skip
    asked = {key: value for key, value in given.items() if value is not None}
    try:
        cells = [load_cell(name) for name in args.cells or shipped("cells")]
    except ConfigError as error:
        print(error, file=sys.stderr)
        return 2
    if args.whole and len(cells) != 1:
        parser.error("--whole: name one cell")
    args.to.mkdir(parents=True, exist_ok=True)
    failed = False
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=args.chromium, args=FLAGS)
        for cell in cells if args.whole is None else ():
            name = cell.config.name
            picture = args.to / f"{name}.png"
            moment = MOMENTS.get(name, Moment())._replace(**asked)
            complaints = take(browser, cell, moment, picture)
            print(f"{picture}: {picture.stat().st_size // 1000} kB", flush=True)
            for complaint in complaints:
                print(f"  {complaint}", file=sys.stderr)
            failed = failed or bool(complaints)
        if args.whole is not None:
            try:
                take_whole(browser, cells[0], args.whole)
            except ChildDied as error:
                print(error, file=sys.stderr)
                failed = True
            else:
                _shrink(args.whole, LARGEST_WHOLE)
        browser.close()
    return 1 if failed else 0
