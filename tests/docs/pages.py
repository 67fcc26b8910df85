"""The blocks of a page, and a folder in which they are worked through in the order of the page."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("config", "drivers", "protocols", "server", "tools")
PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for paths in (
        ROOT.glob("*.md"),
        *((ROOT / f).rglob("*.md") for f in (*FOLDERS, "docs", "tests")),
    )
    for path in paths
    if "node_modules" not in path.parts
)
FENCE = re.compile(
    r'^```(\w*)(?: title="((?:[^"\\]|\\.)*)")?\n(.*?)^```$', re.MULTILINE | re.DOTALL
)
SAVED = re.compile(r"\]\((\w+\.py)\)")
"""Links to programs beside a page."""
INTO = re.compile(r"(\S+), (after|before) the line: (.*)")
STAND_INS = {
    r"^python ": f"{sys.executable} ",
    r"^telerobot ": f"{sys.executable} -m telerobot ",
    r"(?<=\$\()python ": f"{sys.executable} ",
    # Nobody sits at this terminal.
    r"(telerobot demo (?!.*--headless).*)$": r"\1 --headless --seconds 3",
}


class Block(NamedTuple):
    """One fenced block: its language, its title or "", and its text."""

    language: str
    title: str
    text: str


def blocks(page):
    """Return the fenced blocks of a page, from the first to the last."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return [Block(a, b, c) for a, b, c in FENCE.findall(text)]


def commands(page):
    """Return the lines of a page's blocks that call `telerobot`, without their comments."""
    return [
        re.sub(r"\s+#.*", "", line).removesuffix(" &")
        for block in blocks(page)
        for line in block.text.splitlines()
        if block.language in ("", "sh") and line.startswith("telerobot ")
    ]


class Desk:
    """A folder where the files of a page are written and its commands are run."""

    def __init__(self, folder, package=ROOT / ".namespace"):
        self._folder, self._package = folder, package
        self.printed = ""

    def work_through(self, page):
        """Write every titled block, and run every line of the blocks in `sh`.

        Programs that lie beside the page are saved first.
        """
        for program in SAVED.findall((ROOT / page).read_text(encoding="utf-8")):
            shutil.copy((ROOT / page).with_name(program), self._folder)
        for block in blocks(page):
            if block.language == "sh":
                for line in block.text.splitlines():
                    self.run(line)
            elif block.title:
                self._write(block)

    def run(self, line):
        """Run a line in a shell; a failure shows what it printed."""
        for what, stands_in in STAND_INS.items():
            line = re.sub(what, stands_in, line)
        done = subprocess.run(
            line,
            shell=True,
            cwd=self._folder,
            env={**os.environ, "PYTHONPATH": str(self._package)},
            capture_output=True,
            text=True,
            check=False,
        )
        self.printed += done.stdout
        print(f"{line}\n{done.stdout}\n{done.stderr}")  # is shown with what fails later
        assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"

    def _write(self, block):
        if (into := INTO.fullmatch(block.title)) is None:
            path = self._folder / block.title
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
            return
        name, side, beside = into.groups()
        path = self._folder / name
        text = path.read_text(encoding="utf-8")
        assert text.count(f"\n{beside}") == 1, f"{name} has no such line, or several: {beside}"
        at = text.index(f"\n{beside}") + 1
        if side == "after":
            at = text.index("\n", at) + 1
        path.write_text(text[:at] + block.text + text[at:], encoding="utf-8")


def clone(folder):
    """Copy the package to a folder, as a clone has it; return the folder to import it from."""
    for name in FOLDERS:
        shutil.copytree(
            ROOT / name, folder / name, ignore=shutil.ignore_patterns("node_modules", "pictures")
        )
    for name in ("__init__.py", "__main__.py", "py.typed", "pyproject.toml"):
        shutil.copy2(ROOT / name, folder / name)
    shutil.copytree(ROOT / ".namespace", folder / ".namespace", symlinks=True)
    return folder / ".namespace"
