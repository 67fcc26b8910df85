"""Hook of MkDocs: the site is made of the pages beside the code, and of the files they link to."""

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("config", "docs", "drivers", "protocols", "server", "tests", "tools")
ELSEWHERE = ("node_modules", "site", "out")
LINK = re.compile(r"\]\((?!https?:)([^)#\s]+)")


def pages() -> list[Path]:
    """Return all pages of the repository."""
    found = [*ROOT.glob("*.md")]
    for folder in FOLDERS:
        found += (ROOT / folder).rglob("*.md")
    return sorted(path for path in found if not {*path.relative_to(ROOT).parts} & {*ELSEWHERE})


def on_files(files: Files, config: Any) -> Files:
    """Add every page at its place in the repository, and what it shows or links to."""
    wanted = {ROOT / "docs/site.css"}
    for page in pages():
        wanted.add(page)
        for link in LINK.findall(page.read_text(encoding="utf-8")):
            target = (page.parent / link).resolve()
            if target.is_file() and target.is_relative_to(ROOT):
                wanted.add(target)
    for path in sorted(wanted):
        name = path.relative_to(ROOT).as_posix()
        files.append(File.generated(config, name, abs_src_path=str(path)))
    return files
