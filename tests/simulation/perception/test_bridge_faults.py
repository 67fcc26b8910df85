"""Bridges and scanners that misbehave while a rover drives: each ends in a stated, safe state."""

from collections.abc import Callable

import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.rig import BoxSection, RigBridgeSection, RigPersonSection
from telerobot.protocols.messages.rig import RigFault
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation


def rover(
    *drives: tuple[float, float],
    seconds: float,
    bridge: RigBridgeSection | None = None,
    person: RigPersonSection | None = None,
    news: dict[str, object] | None = None,
    boxes: tuple[BoxSection, ...] = (),
) -> Simulation:
    """A run in which the base is driven at speeds [m/s], each from a time [s] on.

    `news` is of an obstacle that is not there.
    """
    cell = load_cell("rover_bridge")
    cell = altered(cell, {"rig.bridge": bridge, "rig.person": person, "rig.boxes": boxes})
    steps = [{"at_s": at_s, "cmd/drive": {"rates": [speed, 0.0]}} for at_s, speed in drives]
    steps += [] if news is None else [{"at_s": 0.4, "sensor/obstacle": news}]
    return Simulation(cell, Script.model_validate({"duration_s": seconds, "step": steps}))


def once(run: Simulation, so: Callable[[], bool], act: Callable[[], None]) -> None:
    """Do something in the first tick in which that is so."""
    done: list[bool] = []

    def on_tick(_run: Simulation) -> None:
        if not done and run.truths and so():
            done.append(True)
            act()

    run.on_tick = on_tick


TURNS_S = 9.0
"""When the base that is driven ahead is half under the bridge [s]."""


def x(run: Simulation) -> float:
    return run.truths[-1].frames["base"][0]


def test_a_tilt_drive_that_sticks_ends_in_a_fault_by_name_and_the_base_stands() -> None:
    run = rover((0.3, 0.3), seconds=1.8)
    stuck = RigFault(kind="block", target="tilt")
    once(run, lambda: run.clock.time_s > 1.5, lambda: run.rig.inject(stuck))
    result = run.run()
    (fault,) = [event for event in run.events if event.name == "fault"]
    assert (fault.values["device"], fault.values["cause"]) == ("tilt", "following_error")
    assert fault.time_s < 1.5 + 0.15
    assert result.summary["mode"] == "fault"
    at = [truth.frames["base"][0] for truth in result.truths]
    assert at[-20] > 0.1
    assert abs(at[-1] - at[-20]) < 1e-3
    assert result.summary["limit_violations"] == 0


def test_a_bridge_that_is_too_low_is_refused_by_name_and_backed_away_from_at_once() -> None:
    low = RigBridgeSection(height=0.86, distance=1.5)
    run = rover((0.3, 0.3), (5.7, -0.3), seconds=6.6, bridge=low)
    result = run.run()
    (refused,) = [event for event in run.events if event.name == "passage_refused"]
    assert refused.values["reason"] == "column_blocked"
    stood = [t.frames["base"][0] for t in result.truths if refused.time_s < t.time_s < 6.2]
    assert 0.1 < stood[-1] < 0.6
    assert max(stood) - min(stood) < 0.02
    assert result.truths[-1].frames["base"][0] < stood[-1] - 0.1
    assert (result.summary["mode"], result.summary["limit_violations"]) == ("enabled", 0)
    assert result.summary["min_clearance_m"] > 0.3


@pytest.mark.parametrize("height", [0.25, 0.12])
def test_a_step_that_only_base_and_scanner_would_meet_is_refused_by_name(height: float) -> None:
    """It is lower than the arm's foot, where the contour begins, and than the scanner's head."""
    step = BoxSection(name="step", xyz=(1.9, 0.0, 0.5 * height), half_size=(0.2, 0.5, 0.5 * height))
    run = rover((0.3, 0.4), seconds=7.0, boxes=(step,))
    result = run.run(lambda: "passage_refused" in [event.name for event in run.events])
    (refused,) = [event for event in run.events if event.name == "passage_refused"]
    assert refused.values["reason"] == "base_blocked"
    assert abs(result.truths[-1].frames["base"][0] - result.truths[-50].frames["base"][0]) < 0.01
    assert (result.summary["mode"], result.summary["limit_violations"]) == ("enabled", 0)
    assert result.summary["min_clearance_m"] > 0.3


def test_a_base_that_clearances_hold_where_nothing_is_seen_is_told_of_and_backs_out_at_once() -> (
    None
):
    """The daemon is told of a crate that is not there: the reflex has no reason to stop for it."""
    crate: dict[str, object] = {
        "name": "crate", "shape": "box", "xyz": (1.1, 0.0, 0.8), "half_size": (0.1, 0.3, 0.3),
        "max_speed": 0.0,
    }  # fmt: skip
    run = rover((0.3, 0.3), (9.0, -0.2), seconds=10.0, news=crate)
    held = []

    def keep(_run: Simulation) -> None:
        if run.states and "held_back" in run.states[-1].limits:
            held.append(run.states[-1].time_s)

    run.on_tick = keep
    result = run.run()
    (refused,) = [event for event in run.events if event.name == "passage_refused"]
    assert refused.values["reason"] == "held_back"
    assert held[0] == pytest.approx(refused.time_s, abs=0.03)
    (over,) = [e for e in run.events if e.name == "passage_clear" and e.time_s > refused.time_s]
    assert held[-1] == pytest.approx(over.time_s, abs=0.03)
    assert x(run) < max(truth.frames["base"][0] for truth in result.truths) - 0.03
    assert (result.summary["mode"], result.summary["limit_violations"]) == ("enabled", 0)


def test_a_beam_that_sinks_ahead_is_stood_still_before_and_backed_away_from_at_once() -> None:
    """High enough to pass at first, it comes down where the scanner sees it."""
    high = RigBridgeSection(height=1.6, distance=1.8)
    run = rover((0.3, 0.3), (4.6, -0.3), seconds=5.2, bridge=high)
    at = [high.height + 0.05]

    def sink(_run: Simulation) -> None:
        if run.clock.time_s > 1.5:
            at[0] = max(0.9, at[0] - 0.01)
            place = (high.distance + 0.05, 0.0, at[0])
            run.rig.inject(RigFault(kind="place", target="bridge_beam", vector=place))

    run.on_tick = sink
    result = run.run()
    before = [event.name for event in run.events if event.time_s < 1.5]
    (seen,) = [event for event in run.events if event.name == "passage_undecided"]
    assert "passage_undecided" not in before
    assert seen.time_s < 1.5 + 1.5
    stood = [t.frames["base"][0] for t in result.truths if 4.0 < t.time_s < 4.5]
    assert 0.3 < stood[0] < high.distance - 0.9
    assert max(stood) - min(stood) < 0.02
    assert x(run) < stood[-1] - 0.05
    assert (result.summary["mode"], result.summary["limit_violations"]) == ("enabled", 0)
    assert result.summary["min_clearance_m"] > 0.3


def test_the_operator_backs_out_from_under_a_bridge_at_once() -> None:
    """Half of it is passed, and neither what is ahead nor what is behind is waited for."""
    made = RigBridgeSection(height=1.0, distance=1.3)
    run = rover((0.3, 0.3), (TURNS_S, -0.3), seconds=TURNS_S + 3.5, bridge=made)
    result = run.run()
    at = {round(t.time_s - TURNS_S, 2): t.frames["base"][0] for t in result.truths}
    foot = at[0.5] + 0.2
    assert abs(foot - (made.distance + 0.05)) < 0.1  # the arm is under the beam
    assert at[1.5] < max(at.values()) - 0.05
    assert at[3.5] < at[0.5] - 0.5
    assert (result.summary["mode"], result.summary["limit_violations"]) == ("enabled", 0)
    assert result.summary["min_clearance_m"] > 0.02


def test_a_beam_that_sinks_onto_the_arm_from_where_nobody_looks_is_given_way_to() -> None:
    """Its scanner does not see what is right above it: the drives feel it, for 16 cm and more."""
    above = RigBridgeSection(height=1.45, distance=0.15, thickness=0.2)
    run = rover(seconds=3.0, bridge=above)
    at = [above.height + 0.05]

    def sink(_run: Simulation) -> None:
        if 0.7 < run.clock.time_s < 2.9:
            at[0] -= 0.001
            place = (above.distance + 0.1, 0.0, at[0])
            run.rig.inject(RigFault(kind="place", target="bridge_beam", vector=place))

    run.on_tick = sink
    result = run.run()
    (touched,) = [event for event in run.events if event.name == "touched"]
    assert at[0] < above.height + 0.05 - 0.1 * (touched.time_s - 0.7) - 0.15
    assert [event.name for event in run.events if event.name == "fault"] == []
    assert result.summary["mode"] == "hold"
    assert min(truth.clearance_m for truth in run.truths) > -0.005
    assert run.observer.violations == []


def test_somebody_who_walks_in_ahead_is_stood_still_before() -> None:
    run = rover((0.3, 0.3), seconds=3.6, person=RigPersonSection(xyz=(6.0, 3.0, 0.0)))

    def walk_in() -> None:
        place = (x(run) + 1.6, 0.0, 0.85)
        run.rig.inject(RigFault(kind="place", target="person", vector=place))

    once(run, lambda: run.clock.time_s > 1.6, walk_in)
    result = run.run()
    (seen,) = [event for event in run.events if event.name == "passage_undecided"]
    assert seen.time_s < 1.6 + 1.0
    at = [truth.frames["base"][0] for truth in result.truths]
    assert 0.1 < at[-1] < 0.6
    assert at[-1] - at[-30] < 0.01
    assert result.summary["min_clearance_m"] > 0.6
    assert (result.summary["mode"], result.summary["limit_violations"]) == ("enabled", 0)
