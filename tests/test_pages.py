"""The pages name what there is: their links lead somewhere, and the files that they name exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("config", "drivers", "protocols", "server", "tools")
UNSHIPPED = "node_modules"
THERE = {
    f"/{path.relative_to(ROOT).as_posix()}"
    for folder in (*FOLDERS, "docs", "tests", ".ci")
    for path in (ROOT / folder, *(ROOT / folder).rglob("*"))
    if UNSHIPPED not in path.parts
}
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / path[1:] for path in THERE if path.endswith(".md"))])
CHANGES = "CHANGELOG.md"
"""Names files as they were called then."""
CODE = re.compile(r"`[^`]*`")
LINK = re.compile(r"\]\((?!https?:)([^)\s]*)\)")
FILE = re.compile(r"`([\w./-]+/[\w.-]+\.(?:py|js|toml|urdf|md))`")
FOLDER = re.compile(r"`((?!(?:cmd|sensor|operator|tlm)/)[\w.-]+(?:/[\w.-]+)*/)`")
"""Keys of topics that begin alike are no folders."""
STANDS_FOR = ("NAME", "RUN", "out/", "runs/", "demo.numpy/", ".namespace/", "vendor/")
"""Parts of names that stand for others, are links, or that a command makes."""


def anchors(page):
    """Return the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_to_a_file_and_a_heading(page):
    lost = []
    for link in LINK.findall(CODE.sub("", page.read_text(encoding="utf-8"))):
        name, _, anchor = link.partition("#")
        target = page if not name else (page.parent / name).resolve()
        if not target.exists() or (anchor and anchor not in anchors(target)):
            lost.append(link)
    assert lost == []


@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if page.name != CHANGES],
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_every_file_and_folder_that_a_page_names_is_there(page):
    text = page.read_text(encoding="utf-8")
    found = [*FILE.findall(text), *FOLDER.findall(text)]
    named = [name.rstrip("/") for name in found if not any(s in name for s in STANDS_FOR)]
    lost = [name for name in named if not any(path.endswith(f"/{name}") for path in THERE)]
    assert lost == []
