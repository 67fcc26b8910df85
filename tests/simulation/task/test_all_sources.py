"""Stick, position, vision and force at once on all axes."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import load_script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

SOURCES = ("joystick", "position", "vision", "force")


@pytest.fixture(scope="module")
def run():
    simulation = Simulation(load_cell("pa10_all"), load_script("all_sources"))
    if simulation.blind is not None:
        pytest.skip(simulation.blind)
    return Run(simulation, simulation.run())


def between(run, start_s, end_s):
    since = run.simulation.player.start_s
    return [s for s in run.states if start_s <= s.time_s - since < end_s]


def test_the_script_plays_without_refusal_fault_or_violation(run):
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0
    assert [e for e in run.simulation.events if e.severity == "error"] == []


def test_every_source_contributes_on_every_axis_at_once(run):
    rates = np.array([[s.sources[name] for name in SOURCES] for s in between(run, 6.5, 9.0)])
    typical = np.median(np.abs(rates), axis=0)
    assert typical[:, :3].min() > 1e-3
    assert typical[:, 3:].min() > 2e-3
    # And in one and the same tick: each of the 24 above what noise makes of it.
    assert (np.abs(rates) > 5e-4).all(axis=(1, 2)).any()


def test_the_sum_is_that_of_the_sources_to_machine_precision(run):
    for state in between(run, 3.0, 14.0):
        total = np.sum([state.sources[name] for name in (*SOURCES, "frames")], axis=0)
        np.testing.assert_allclose(total, state.twist, rtol=0, atol=1e-15)


def test_the_tool_touches_the_plate_and_what_it_presses_is_in_the_sum(run):
    since = run.simulation.player.start_s
    pressed = [t.contact_force[0] for t in run.truths if 7.5 < t.time_s - since < 9.0]
    assert np.mean(pressed) > 5.0
    gain = run.simulation.cell.config.sources.force.gain[0]
    (state,) = between(run, 8.5, 8.51)
    # The tool's z is World's x: it backs off by what is beyond the 3 N that are asked.
    assert state.sources["force"][0] == pytest.approx(gain * (3.0 - state.wrench_mrf[2]), abs=1e-3)


def test_what_is_left_when_stick_position_and_force_are_off_is_the_stored_view(run):
    assert run.summary["view_error_m"] < 5e-3
    assert run.summary["view_error_rad"] < 1e-2
