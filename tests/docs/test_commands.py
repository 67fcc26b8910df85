"""Commands of the pages are ones that there are, on cells and scripts that are shipped."""

import re
import shlex
import tomllib

import pytest
from telerobot.config.load import shipped
from telerobot.tools.cli import COMMANDS, build_parser

from .pages import PAGES, ROOT, Desk, commands

README = (ROOT / "README.md").read_text(encoding="utf-8")
SIMULATED = sorted(set(re.findall(r"`(telerobot simulate [^`]*)`", README)))


@pytest.fixture(scope="module")
def parser():
    return build_parser(COMMANDS)


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)])
def test_every_command_of_a_page_is_one_of_ours(parser, page):
    for line in commands(page):
        args = parser.parse_args(shlex.split(re.sub(r"[<>|&].*", "", line))[1:])
        for kind in ("cell", "script"):
            name = getattr(args, kind, None)
            if isinstance(name, str) and re.fullmatch(r"[a-z0-9_]+", name):
                assert name in shipped(f"{kind}s"), line


def test_the_readme_installs_extras_that_there_are():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = re.findall(r"telerobot\[(\w+)\]", "".join((ROOT / p).read_text() for p in PAGES))
    assert "console" in asked
    assert set(asked) <= set(extras["optional-dependencies"])


def test_the_readme_makes_targets_that_there_are():
    there = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for page in PAGES:
        text = (ROOT / page).read_text(encoding="utf-8")
        named = re.findall(r"(?:^|`)make ([a-z-]+)(?=`|  | *$)", text, re.MULTILINE)
        assert set(named) <= there, page


def test_the_readme_is_short():
    assert len(README.splitlines()) <= 150


@pytest.mark.slow
@pytest.mark.parametrize("line", SIMULATED)
def test_what_the_readme_simulates_reaches_what_its_script_expects(tmp_path, line):
    Desk(tmp_path).run(line)


@pytest.mark.hil
@pytest.mark.alone
def test_the_readmes_demo_drives_itself_without_a_keyboard(tmp_path):
    (line,) = re.findall(r"`(telerobot demo --headless [^`]*)`", README)
    desk = Desk(tmp_path)
    desk.run(line)
    assert "enabled" in desk.printed
