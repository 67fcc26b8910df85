"""Cameras in a process of their own, beside daemon and rig."""

import json
import subprocess
import sys

import pytest

pytestmark = [pytest.mark.hil, pytest.mark.usefixtures("rendering")]

TELEROBOT = [sys.executable, "-m", "telerobot.tools.cli"]


def test_a_view_is_stored_from_pictures_of_another_process():
    done = subprocess.run(
        [*TELEROBOT, "demo", "pa10_vision", "--json", "--seconds", "9.5"],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["healthy"]
    assert summary["refused"] == []
    assert "view_found" in done.stderr
    assert "view_stored" in done.stderr


def test_without_a_daemon_the_process_waits_and_ends_when_told():
    done = subprocess.run(
        [*TELEROBOT, "vision", "pa10_vision", "--endpoint=tcp/127.0.0.1:9", "--seconds", "1"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0
    assert "waiting: nobody answers at tcp/127.0.0.1:9" in done.stderr
    assert "wrist: 0 pictures" in done.stdout
