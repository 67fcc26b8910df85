"""The site has every page of the repository, once."""

import re

from .pages import FOLDERS, ROOT


def test_every_page_has_its_place_on_the_site():
    text = (ROOT / "docs/mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")[1]
    named = re.findall(r"([\w./-]+\.md)$", text, re.MULTILINE)
    there = {
        path.relative_to(ROOT).as_posix()
        for paths in (ROOT.glob("*.md"), *((ROOT / f).rglob("*.md") for f in (*FOLDERS, "docs")))
        for path in paths
        if "node_modules" not in path.parts
    }
    assert sorted(named) == sorted(there)
