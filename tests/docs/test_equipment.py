"""What a clone brings for containers, editors and reviewers names things that there are."""

import json
import re
import tomllib
from pathlib import Path

import pytest
from laboratory.vendor.build_hook import BESIDE, portable
from telerobot.tools.cli import COMMANDS, build_parser

from .pages import ROOT


def text(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_container_serves_a_cell_with_extras_that_there_are():
    image = text("Containerfile")
    serve = json.loads(re.findall(r"^CMD (\[.*\])$", image, re.MULTILINE)[0])
    assert build_parser(COMMANDS).parse_args(serve).command == "serve"
    (extras,) = re.findall(r"telerobot\[([\w,]+)\] @", image)
    known = tomllib.loads(text("pyproject.toml"))["project"]["optional-dependencies"]
    assert set(extras.split(",")) <= set(known)
    assert text(".containerignore") == text(".dockerignore")


def test_the_container_is_built_from_what_there_is():
    image = text("Containerfile")
    targets = re.findall(r"&& make (\S+)", image)
    assert targets
    assert set(targets) <= set(re.findall(r"^([a-z-]+):", text("Makefile"), re.MULTILINE))
    (pins,) = set(re.findall(r"-c (\S+)", image))
    assert "\nbuild==" in text(pins)
    ignored = text(".containerignore").split()
    for needed in ("pyproject.toml", "vendor", "tools", "config", ".namespace", pins, "README.md"):
        assert (ROOT / needed).exists()
        assert needed not in ignored
    black_boxes = re.findall(r"STATE_DIRECTORY=(\S+)", image)
    assert black_boxes == re.findall(r"--home-dir (\S+)", image)
    assert '"STATE_DIRECTORY"' in text("tools/arguments.py")


def test_the_container_does_not_run_as_root_nor_in_the_folder_of_the_sources():
    last = text("Containerfile").split("\nFROM ")[-1]
    assert re.search(r"^USER telerobot$", last, re.MULTILINE)
    assert "COPY . " not in last


def test_the_devcontainer_builds_from_its_file():
    told = json.loads(text(".devcontainer/devcontainer.json"))
    assert (ROOT / ".devcontainer" / told["build"]["dockerfile"]).is_file()


def test_hooks_before_a_commit_are_the_checks_of_make():
    entries = re.findall(r"entry: \.venv/bin/(\S+)", text(".pre-commit-config.yaml"))
    checked = re.findall(r"\$\(BIN\)/(\S+)", text("Makefile").split("\ncheck:")[1].split("\n\n")[0])
    assert {*checked} <= {*entries}


def test_the_citation_names_the_version_of_the_package_and_five_papers():
    told = text("CITATION.cff")
    version = tomllib.loads(text("pyproject.toml"))["project"]["version"]
    assert f"\nversion: {version}\n" in told
    papers = told.split("\nreferences:\n")[1]
    assert len(re.findall(r"^  - type:", papers, re.MULTILINE)) == 5
    for place in re.findall(r"(?:server|tools)/[\w/.]+", papers):
        assert Path(ROOT / place).exists(), place


@pytest.mark.parametrize("address", ["", "https://example.org/a/b"])
def test_the_page_on_an_index_names_no_file_beside_it(address):
    page = text("README.md")
    told = portable(page, address)
    assert BESIDE.search(page)
    assert not BESIDE.search(told)
    assert told.count("\n") == page.count("\n")
    for mark, words, path in BESIDE.findall(page):
        whole = f"{mark}[{words}]({address}/{'raw' if mark else 'blob'}/HEAD/{path})"
        assert (whole if address else words) in told
        assert (ROOT / path.partition("#")[0]).exists()
