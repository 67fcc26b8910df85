"""A virtual fixture through the whole line: a script, the lease, the tick, the bus, physics."""

import numpy as np
import pytest
from telerobot.config.load import altered
from telerobot.config.schema.sources import SpringSection


def test_a_tool_on_its_fixture_glides_along_a_line_and_an_operator_lets_go_of_it(play, pa10):
    ready = play(seconds=0.3).truths[-1].pose_mrf[:3]
    line = SpringSection(gain=(2.0,) * 3 + (0.0,) * 3, point=ready, direction=(0.0, 1.0, 0.0))
    stick = {"twist": [0.04, 0.04, 0.0, 0.0, 0.0, 0.0], "expressed_in": "base"}
    run = play(
        {"at_s": 0.2, "cmd/joystick": stick},
        {"at_s": 3.2, "operator/gain": {"source": "spring", "gain": [99.0] * 6}},
        {"at_s": 3.3, "operator/switch": {"source": "spring", "on": False}},
        {"at_s": 4.8, "silence": ["cmd/joystick"]},
        {"at_s": 5.2, "operator/switch": {"source": "spring", "on": True}},
        seconds=8.5,
        cell=altered(pa10, {"sources.spring": line, "rig.wall": None, "rig.boxes": ()}),
    )
    away = {at: np.array(run.at(at).pose_mrf_measured[:3]) - ready for at in (3.2, 5.2, 8.4)}
    assert away[3.2][0] == pytest.approx(0.04 / 2.0, rel=0.03)  # it stands off by u / K_S
    assert away[3.2][1] == pytest.approx(0.04 * 3.0, rel=0.06)
    assert away[5.2][0] == pytest.approx(0.02 + 0.04 * 1.5, rel=0.1)  # let go
    assert abs(away[8.4][0]) < 1e-3
    assert run.summary["limit_violations"] == 0
    assert run.at(3.2).sources["spring"][0] == pytest.approx(-0.04, rel=0.03)
    assert not run.at(4.5).on["spring"]
    refused = [e.values["reason"] for e in run.events("request_refused")]
    assert refused == ["unstable_gain"]
