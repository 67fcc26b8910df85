"""The site has every page of the repository, once."""

import re

from .pages import PAGES, ROOT


def test_every_page_has_its_place_on_the_site():
    text = (ROOT / "docs/mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")[1]
    named = re.findall(r"([\w./-]+\.md)$", text, re.MULTILINE)
    assert sorted(named) == PAGES
