"""A rover in the whole closed loop: daemon, drives, physics, every ray of its scanner."""

from collections.abc import Callable

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.protocols.messages.rig import RigFault
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation


def rover(
    steps: list[dict[str, object]], seconds: float, rule: str = "posture", **bridge: float
) -> Simulation:
    """A run with a bridge that is near."""
    cell = load_cell("rover_bridge")
    cell = altered(cell, {"contour.rule": rule, "rig.bridge.distance": 1.7})
    cell = altered(cell, bridge, "rig.bridge")
    return Simulation(cell, Script.model_validate({"duration_s": seconds, "step": steps}))


def drive(speed: float, at_s: float = 0.3) -> dict[str, object]:
    return {"at_s": at_s, "cmd/drive": {"rates": [speed, 0.0]}}


def names(run: Simulation) -> list[str]:
    return [event.name for event in run.events]


def x(run: Simulation) -> float:
    return run.truths[-1].frames["base"][0]


def when(run: Simulation, time_s: float, act: Callable[[], None]) -> None:
    """Do something once at a time."""
    done: list[bool] = []

    def on_tick(_run: Simulation) -> None:
        if not done and run.clock.time_s >= time_s:
            done.append(True)
            act()

    run.on_tick = on_tick


def test_the_rover_ducks_under_the_bridge_and_unfolds_again() -> None:
    run = rover([drive(0.3)], 40.0)
    result = run.run(lambda: "passage_clear" in names(run) and x(run) > 2.8)
    phases = [name for name in names(run) if name.startswith("passage_")]
    assert phases == [
        "passage_undecided", "passage_folding", "passage_folded", "passage_returning",
        "passage_clear",
    ]  # fmt: skip
    at = {event.name: event.time_s for event in run.events}
    assert at["passage_folded"] - at["passage_folding"] < 8.0
    s = result.summary
    assert (s["failure"], s["limit_violations"], s["mode"]) == (None, 0, "enabled")
    assert s["min_clearance_m"] > 0.05
    arm = np.array([truth.q[2:9] for truth in result.truths])
    assert np.abs(arm[:, 3]).max() <= 2.094
    np.testing.assert_allclose(arm[-1], arm[0], atol=0.05)


@pytest.mark.parametrize(("height", "width", "steps"), [(1.05, 1.4, 1), (1.15, 0.9, 2)])
def test_by_the_papers_order_the_rover_folds_tool_and_elbow_and_passes(
    height: float, width: float, steps: int
) -> None:
    """Below the wide bridge the tool alone has to move; below the narrow one the elbow, too."""
    run = rover([drive(0.3)], 30.0, "sequence", height=height, width=width)
    s = run.run(lambda: "passage_returning" in names(run) and x(run) > 2.6).summary
    assert "passage_refused" not in names(run)
    assert names(run).count("passage_folding") >= steps
    assert x(run) > 2.6
    assert (s["failure"], s["limit_violations"], s["mode"]) == (None, 0, "enabled")
    assert s["min_clearance_m"] > 0.02


def test_without_avoidance_the_arm_hits_it() -> None:
    off = {"at_s": 0.1, "operator/avoidance": {"on": False}}
    run = rover([off, drive(0.3)], 12.0)
    result = run.run(lambda: bool(run.truths) and run.truths[-1].clearance_m <= 0.0)
    assert result.summary["min_clearance_m"] <= 0.0


def test_a_scanner_that_falls_silent_while_the_base_drives_stops_it() -> None:
    run = rover([drive(0.3)], 4.0, distance=6.0)
    when(run, 1.5, lambda: run.rig.inject(RigFault(kind="silence", target="scanner")))
    run.run()
    at = {event.name: event.time_s for event in run.events}
    assert 1.5 < at["scanner_silent"] < 1.5 + 0.35
    assert run.cycle.mode == "hold"
    assert abs(run.truths[-1].dq[0]) < 1e-3
    assert run.observer.violations == []


def test_without_a_scanner_nobody_drives_ahead_but_slowly_back() -> None:
    run = rover([drive(0.2), drive(-0.2, 1.5)], 4.0)
    run.rig.inject(RigFault(kind="silence", target="scanner"))
    where = []
    run.on_tick = lambda run: where.append(x(run))
    run.run()
    assert max(where) < 1e-3
    assert -0.13 < where[-1] < -0.1
    assert names(run).count("unseen_behind") == 1
    assert "unseen_behind" in run.states[-1].limits
    assert run.cycle.mode == "enabled"


def test_telegrams_that_are_cut_garbled_or_of_another_range_are_no_scans() -> None:
    for kind, words in (
        ("drop", "was cut"),
        ("corrupt", "value"),
        ("crop", "rays: value 181"),
    ):
        run = rover([drive(0.2)], 1.5)
        run.rig.inject(RigFault(kind=kind, target="scanner"))
        run.run()
        assert x(run) < 1e-3
        scanning = run.scans.scanning
        assert scanning.scans == 0
        assert scanning.refused > 10
        assert run.cycle.units.each[0].perception.passage.silent
        assert words in " ".join(scanning.events)
