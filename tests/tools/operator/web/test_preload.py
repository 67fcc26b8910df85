"""The page asks for all of its modules at once, and for the scene's only when it draws."""

import os
import re
from pathlib import Path

STATIC = Path(__file__).resolve().parents[4] / "tools/operator/web/static"
IMPORT = re.compile(r'^import[^;]*?from "(\.[^"]+)"', re.MULTILINE)


def reached(name, found):
    """Return the modules that a module imports, and all that these do."""
    if name not in found and not name.startswith("vendor/"):
        found.add(name)
        for other in IMPORT.findall((STATIC / name).read_text(encoding="utf-8")):
            reached(os.path.normpath(Path(name).parent / other), found)
    return found


def test_every_module_that_the_page_begins_with_is_asked_for_at_once():
    page = (STATIC / "index.html").read_text(encoding="utf-8")
    asked = set(re.findall(r'rel="modulepreload" href="([^"]+)"', page))
    own = {name for name in asked if not name.startswith("vendor/")}
    assert own == reached("app.js", set()) - {"app.js"}


def test_the_scene_is_none_of_them():
    assert not {name for name in reached("app.js", set()) if name.startswith("scene/")}
