"""Field, virtual spheres and barriers on at once, in the one tick."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

ALL_ON = """
extends = "pa10_scene"
name = "composed"
[potential]
obstacles = 0.3
joint_limits = 0.1
[priority]
inner_radius = 0.3
outer_radius = 0.7
joints = ["s1", "s3"]
[[priority.spheres]]
name = "elbow"
link = "link4"
[redundancy]
mid_range = 0.2
manipulability = 0.5
field = 1.0
spheres = 1.0
"""

FIELD_OFF_S, BARRIERS_OFF_S = 6.0, 9.2


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp("cell") / "composed.toml"
    path.write_text(ALL_ON, encoding="utf-8")
    cell = load_cell(path)
    script = load_script("obstacle_drive_into")
    step = type(script.step[0])
    steps = (
        *script.step,
        step.model_validate(
            {"at_s": FIELD_OFF_S, "operator/redundancy": {"objective": "field", "gain": 0}}
        ),
        step.model_validate({"at_s": BARRIERS_OFF_S, "operator/avoidance": {"on": False}}),
    )
    script = Script.model_validate(
        {**script.model_dump(exclude={"step"}), "step": sorted(steps, key=lambda s: s.at_s)}
    )
    simulation = Simulation(cell, script)
    return Run(simulation, simulation.run())


def test_with_all_of_it_on_every_promise_is_kept(run):
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert run.summary["limit_violations"] == 0
    assert run.summary["min_clearance_m"] > run.simulation.cell.config.avoidance.clearance
    assert [e for e in run.simulation.events if e.severity == "error"] == []


def test_the_barriers_had_the_last_word_and_self_motion_stayed_inside_its_bound(run):
    acting = [s for s in run.states if any(name.startswith("clearance:") for name in s.limits)]
    assert len(acting) > 50
    config = run.simulation.cell.config
    V = np.array([drive.max_velocity for drive in config.mechanism.drives])
    fastest = max(np.max(np.abs(s.self_motion) / V) for s in run.states)
    assert 0.0 < fastest <= config.redundancy.max_rate * (1 + 1e-9)


def test_telemetry_shows_each_of_them_at_work(run):
    seen = [run.at(t) for t in (4.4, 4.8, 5.2, 5.6)]
    for state in seen:
        assert state.avoiding
        assert state.gaps
        assert set(state.spheres) == {"elbow"}
        assert set(state.potential) >= {"obstacles", "joint_limits"}
    for objective in ("field", "spheres", "manipulability", "mid_range"):
        gain, size = np.max([s.objectives[objective] for s in seen], axis=0)
        assert gain > 0.0
        assert size > 0.0, objective


def test_each_is_switched_off_by_itself_while_the_arm_moves(run):
    before, between, after = run.at(FIELD_OFF_S - 0.1), run.at(BARRIERS_OFF_S - 0.1), run.at(9.9)
    assert before.potential is not None
    assert before.gaps
    assert between.potential is None
    assert between.gaps
    assert after.gaps == ()
    assert not after.avoiding
    assert after.spheres
