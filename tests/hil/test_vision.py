"""Cameras in a process of their own, beside daemon and rig."""

import json
import subprocess
import sys

import numpy as np
import pytest
from telerobot.protocols import topics as t
from telerobot.protocols.messages.perception import RigMotion
from telerobot.tools.simulation.judges import ViewJudge

pytestmark = [pytest.mark.hil, pytest.mark.alone, pytest.mark.usefixtures("rendering")]

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


SWAYING = """
extends = "pa10_vision"
name = "pa10_swaying"
[frames.base]
speed = 0.5
"""


def test_a_view_is_kept_from_a_platform_that_sways(make_plant, tmp_path):
    cell = tmp_path / "pa10_swaying.toml"
    cell.write_text(SWAYING)
    plant = make_plant(cell)
    operator = plant.enabled_operator()
    operator.posture("ready")
    plant.reach(operator, 20.0)
    plant.until(lambda: operator.state.view is not None, 10.0, "the camera sees nothing")
    plant.run_for(0.5)
    judge = ViewJudge(plant.cell)
    operator.request(t.STORE_VIEW, camera="wrist")
    plant.run_for(0.1)
    judge.on_event(next(e for e in operator.events if e.name == "view_stored"), plant.truth)
    operator.request(t.SWITCH, source="vision", on=True)
    sway = (0.0, 0.04, 0.02, 0.02, 0.0, 0.03)
    operator.inject(RigMotion(target="platform", sway=sway, period_s=4.0))
    plant.run_for(3.0)
    first = len(plant.truths)
    plant.run_for(4.0)
    swaying = plant.truths[first:]
    assert np.ptp([truth.frames["base"][1] for truth in swaying]) > 0.07
    metres, radians = np.max([judge.error(truth) for truth in swaying], axis=0)
    assert metres < 6e-3
    assert radians < 10e-3
    assert [e for e in operator.events if e.severity == "error"] == []
