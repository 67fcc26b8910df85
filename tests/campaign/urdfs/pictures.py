"""Pictures of cells as the page draws them in Chromium, what speaks against them, a sheet."""

import json
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from laboratory.vendor.fetch import missing
from telerobot.config.load import Cell
from telerobot.tools.operator.web.scene import scene_of
from telerobot.tools.simulation.simulation import Result

from ...equipment.pictures.moments import TRAIL_S, Moment, Run

ACROSS: Final = 7
"""Pictures of a row of the sheet [1]."""
SMALL: Final = (320, 200)


def look(cell: Cell, run: Result, picture: Path) -> list[str]:
    """Draw a run's last moment in Chromium; return the links that draw nothing, and complaints.

    Nothing where there is no Chromium, no Playwright or no JavaScript of the page.
    """
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        return []
    if chromium is None or missing():
        return []
    from ...equipment.pictures.stills import FLAGS, take

    states = [state for state in run.states if state.time_s >= run.states[-1].time_s - TRAIL_S]
    moment = Run([json.loads(state.model_dump_json()) for state in states[::4] + states[-1:]], [])
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        complaints = take(browser, cell, Moment(), picture, moment)
        browser.close()
    return [f"page: {told}" for told in (*bare_links(cell), *complaints)]


def bare_links(cell: Cell) -> Iterator[str]:
    """Yield the links that have a shape in their URDF, and none on the page."""
    links = {link["name"]: link["shapes"] for link in scene_of(cell).description["links"]}
    for part in cell.parts:
        for link in part.robot.tree().findall("link"):
            shaped = link.find("visual/geometry/*") is not None
            shaped = shaped or link.find("collision/geometry/*") is not None
            name = f"{part.prefix}{link.get('name')}"
            if shaped and not links[name]:
                yield f"link {name} draws nothing"


def write_sheet(pictures: Sequence[Path], sheet: Path) -> None:
    """Write pictures beside each other, each with its name; nothing where Pillow is not there."""
    try:
        from PIL import Image, ImageDraw
    except ImportError:
        return
    width, height = SMALL
    whole = Image.new("RGB", (ACROSS * width, -(-len(pictures) // ACROSS) * height))
    pen = ImageDraw.Draw(whole)
    for i, picture in enumerate(pictures):
        at = (i % ACROSS * width, i // ACROSS * height)
        with Image.open(picture) as image:
            whole.paste(image.convert("RGB").resize(SMALL), at)
        pen.text((at[0] + 6, at[1] + 4), picture.stem, fill=(255, 255, 255))
    whole.save(sheet)
