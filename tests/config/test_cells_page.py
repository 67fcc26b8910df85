"""The page of cells names every cell that is shipped, and every guide."""

import re
from pathlib import Path

CONFIG = Path(__file__).resolve().parents[2] / "config"
PAGE = (CONFIG / "README.md").read_text(encoding="utf-8")


def test_every_shipped_cell_has_its_place_on_the_page():
    rows = PAGE.split("## Shipped cells\n")[1]
    named = {name for row in rows.splitlines() for name in re.findall(r"`(\w+)`", row)}
    assert named == {path.stem for path in (CONFIG / "cells").glob("*.toml")}


def test_every_guide_is_listed():
    listed = set(re.findall(r"\(guides/(\w+)\.md\)", PAGE))
    assert listed == {path.stem for path in (CONFIG / "guides").glob("*.md")}
