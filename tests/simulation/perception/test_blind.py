"""What is left where a machine can make no pictures: everything else."""

import os
import subprocess
import sys

import pytest
from telerobot.config.load import load_cell
from telerobot.tools.cli import main
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run


@pytest.fixture
def no_opencv(monkeypatch):
    """Take OpenCV away, and everything that has been made with it."""
    for name in [n for n in sys.modules if n.startswith("telerobot.drivers.vision.")]:
        monkeypatch.delitem(sys.modules, name)
    pictures = (
        "drivers.rig.physics.camera",
        "drivers.rig.physics.drawing",
    )
    for name in (f"telerobot.{module}" for module in pictures):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "cv2", None)


def test_a_cell_with_cameras_runs_without_pictures_and_says_why_in_one_line(no_opencv, capsys):
    steps = [
        {"at_s": 0.2, "cmd/joystick": {"twist": [0.0, 0.05, 0.0, 0.0, 0.0, 0.0]}},
        {"at_s": 1.0, "operator/store_view": {"camera": "wrist"}},
    ]
    script = Script.model_validate({"duration_s": 1.2, "step": steps})
    simulation = Simulation(load_cell("pa10_vision"), script)
    run = Run(simulation, simulation.run())
    assert run.summary["failure"].startswith("simulated without its cameras: pictures need OpenCV")
    assert not run.result.ok
    assert run.summary["limit_violations"] == 0
    assert run.truths[-1].pose_mrf[1] > 0.02
    assert "sensor_stale: camera wrist sees no tag now" in run.summary["refused"][0]
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("telerobot: no pictures: pictures need OpenCV")
    assert "pip install" in simulation.blind


def test_the_command_then_says_why_and_ends_with_1(no_opencv, capsys, tmp_path):
    script = tmp_path / "short.toml"
    script.write_text("duration_s = 0.1\n", encoding="utf-8")
    assert main(["simulate", "pa10_vision", str(script)]) == 1
    (line,) = [x for x in capsys.readouterr().out.splitlines() if x.startswith("failure")]
    assert "simulated without its cameras: pictures need OpenCV" in line
    assert "pip install" in line


TWICE = """
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import simulate
for _ in range(2):
    result = simulate(load_cell("pa10_vision"), Script(duration_s=0.3))
    print(result.summary["failure"], result.summary["view_error_m"])
"""


@pytest.mark.parametrize(
    "nothing", [{"MUJOCO_GL": "glfw", "DISPLAY": ":none", "WAYLAND_DISPLAY": ""},
                {"MUJOCO_GL": "disable"}],
    ids=["no display", "switched off"],
)  # fmt: skip
def test_without_opengl_pictures_are_drawn_time_and_again(nothing):
    ran = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", TWICE],
        env={**os.environ, **nothing},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    first, second = ran.stdout.splitlines()
    assert first.split()[0] == "None"
    assert second == first
