"""The systemd unit of the documentation is one that systemd takes, and that our command takes."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from telerobot.tools.cli import COMMANDS, build_parser

GUIDE = Path(__file__).resolve().parents[2] / "config/guides/service.md"
COMMAND = "/opt/telerobot/.venv/bin/telerobot"


@pytest.fixture
def unit():
    (text,) = re.findall(r"```ini\n(\[Unit\].*?)```", GUIDE.read_text(), re.DOTALL)
    return text


def test_its_command_is_one_of_ours(unit):
    (line,) = re.findall(rf"^ExecStart={COMMAND} (.*)$", unit, re.MULTILINE)
    serve = next(command for command in COMMANDS if command.name == "serve")
    assert build_parser((serve,)).parse_args(line.split()).command == "serve"


def test_systemd_has_nothing_against_it(unit, tmp_path):
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("systemd-analyze is not on this machine")
    path = tmp_path / "telerobot.service"
    path.write_text(unit.replace(COMMAND, sys.executable))
    found = subprocess.run(
        [analyze, "verify", str(path)], capture_output=True, text=True, check=False
    )
    assert (found.returncode, found.stderr) == (0, "")
