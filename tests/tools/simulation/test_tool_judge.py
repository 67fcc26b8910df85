"""The judge of the tool believes the script and the physics, and nothing of the controller."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.commands import commands
from telerobot.server.control.spatial import Pose
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import simulate

ASIDE = {"xyz": [0.0, 0.05, 0.0], "rpy": [0.0, 0.0, 0.1], "relative_to": "mrf"}


def error(*steps, seconds=2.5):
    script = Script.model_validate({"duration_s": seconds, "step": list(steps)})
    summary = simulate(load_cell("pa10"), script).summary
    assert summary["failure"] is None
    return summary["tool_error_m"], summary["tool_error_rad"]


def at(at_s, **what):
    (key, fields) = next(iter(what.items()))
    return {"at_s": at_s, key.replace("_", "/", 1): fields}


@pytest.mark.parametrize("expressed_in", [None, "base", "mrf"])
def test_a_target_that_is_reached_is_reached_by_the_physics(expressed_in):
    axes = {} if expressed_in is None else {"expressed_in": expressed_in}
    metres, radians = error(at(0.2, cmd_position={**ASIDE, **axes}))
    assert metres < 1e-3
    assert radians < 2e-3


def test_a_controller_that_misplaces_its_target_does_not_judge_itself(monkeypatch):
    meant = commands.placed

    def misplaced(*given):
        T = meant(*given)
        return Pose(T.R, T.p + np.array([0.0, 0.0, 0.03]))

    monkeypatch.setattr(commands, "placed", misplaced)
    metres, _ = error(at(0.2, cmd_position=ASIDE))
    assert metres == pytest.approx(0.03, abs=1e-3)


def test_a_target_that_the_daemon_refused_is_missed_all_the_same():
    unknown = {**ASIDE, "relative_to": "world", "expressed_in": "lens"}
    metres, _ = error(at(0.2, cmd_position=ASIDE), at(1.8, cmd_position=unknown))
    assert metres > 0.5


def test_the_point_that_is_sent_is_the_mrf_of_then():
    metres, radians = error(
        at(0.1, operator_frame={"frame": "mrf", "xyz": [0.0, 0.0, 0.2]}),
        at(0.2, cmd_position=ASIDE),
        at(0.4, operator_frame={"frame": "mrf", "xyz": [0.0, 0.02, 0.121]}),
    )
    assert metres < 1e-3
    assert radians < 2e-3


def test_nothing_is_judged_after_a_posture_was_asked_for():
    assert error(at(0.2, cmd_position=ASIDE), at(1.0, cmd_posture={"posture": "start"})) == (
        None,
        None,
    )
