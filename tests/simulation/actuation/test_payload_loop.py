"""A tool that follows a hand, or a force, does not swing by its own payload; or it is refused."""

import numpy as np
import pytest
from laboratory.campaign.payloads import STANDS, laden, pushed, speed_at_the_end
from telerobot.config.load import Cell, altered
from telerobot.server.stability.loops import following_source, heaviest
from telerobot.tools.checks.findings import Severity
from telerobot.tools.checks.judge import judge
from telerobot.tools.scripts.script import Step
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

OWN = 0.98
"""Mass of the grip [kg]."""


def played(cell: Cell, force=(0.0, 4.0, 0.0), seconds=1.0, *more) -> Run:
    """Return a run in which a hand pushes for a while, and is awaited to come to rest."""
    script = pushed(force, seconds)
    steps = (*script.step, *(Step.model_validate(step) for step in more))
    simulation = Simulation(cell, script.model_copy(update={"step": steps}))
    return Run(simulation, simulation.run())


@pytest.mark.parametrize(
    ("mode", "more", "mass", "damping"),
    [
        ("csp", 1.0, 1.0, 20.0),
        ("csp", 0.0, 0.5, 15.0),
        ("csp", 5.0, 0.5, 10.0),
        ("csv", 5.0, 0.5, 60.0),
        ("csv", 3.0, 5.0, 12.0),  # at 10 its own M / B = 0.5 s leaves just 0.01 m/s
        ("cst", 5.0, 0.5, 10.0),
        ("cst", 3.0, 1.0, 20.0),
    ],
)
def test_after_a_push_the_tool_is_at_rest_within_two_seconds(mode, more, mass, damping):
    run = played(laden(more, mode, mass=mass, damping=damping))
    assert speed_at_the_end(run.simulation) < STANDS
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0


def test_in_cst_a_heavy_tool_that_is_declared_does_not_sag_when_enabled():
    cell = laden(5.0, "cst")
    run = played(cell, (0.0, 0.0, 0.0))
    start = np.array(cell.config.mechanism.postures["start"])
    assert run.summary["mode"] == "enabled"
    # it falls freely for the 20 ms between brake and torque, and is caught
    assert np.abs(np.array([truth.q for truth in run.truths]) - start).max() < 0.06
    assert speed_at_the_end(run.simulation) < 1e-3


def bound_of(cell: Cell) -> float:
    return heaviest(cell, lambda m: following_source(cell, m), postures=("ready",))


@pytest.mark.parametrize(("mass", "damping"), [(0.5, 15.0), (1.0, 20.0), (2.0, 20.0)])
def test_the_bound_of_the_payload_is_that_of_the_simulation_within_30_percent(mass, damping):
    """With two samples a period; the push is short, as the bound is that of one posture."""

    def cell(payload):
        return laden(payload - OWN, rate_hz=200, mass=mass, damping=damping)

    bound = bound_of(cell(OWN + 2.0))
    below, beyond = (
        speed_at_the_end(played(cell(part * bound), (6.0, 3.0, 0.0), 0.15).simulation)
        for part in (0.77, 1.3)
    )
    assert below < STANDS < beyond


def test_a_payload_that_would_swing_the_tool_is_an_error_of_check():
    light = {"rate_hz": 200, "mass": 0.5, "damping": 15.0}
    fine, heavy = (
        {f.check: f for f in judge(laden(more, **light))}["following payload"]
        for more in (0.0, 2.0)
    )
    assert fine.status is not Severity.ERROR
    assert heavy.status is Severity.ERROR
    assert heavy.values["payload"] == pytest.approx(2.98)
    assert 0.98 < heavy.values["bound"] < 2.98
    assert f"{heavy.values['bound']:.3g} kg" in heavy.text


def test_a_payload_that_would_swing_the_tool_is_refused_with_the_numbers():
    heavy = {"at_s": 0.3, "operator/payload": {"mass": 2.98, "com": [0.0, 0.0, 0.08]}}
    cell = laden(0.0, rate_hz=200, mass=0.5, damping=15.0)
    run = played(cell, (0.0, 4.0, 0.0), 0.3, heavy)
    assert run.events("payload_set") == []
    (refused,) = run.events("request_refused")
    assert refused.values["reason"] == "unstable_payload"
    assert "2.98 kg" in refused.detail
    assert "stable below" in refused.detail
    assert run.states[-1].payload[0] == pytest.approx(0.98)


def test_following_is_not_switched_on_under_a_payload_that_would_swing_the_tool():
    steps = (
        {"at_s": 0.2, "operator/switch": {"source": "following", "on": False}},
        {"at_s": 0.3, "operator/payload": {"mass": 2.98, "com": [0.0, 0.0, 0.08]}},
        {"at_s": 0.4, "operator/switch": {"source": "following", "on": True}},
    )
    cell = laden(0.0, rate_hz=200, mass=0.5, damping=15.0)
    run = played(cell, (0.0, 0.0, 0.0), 0.3, *steps)
    assert len(run.events("payload_set")) == 1
    assert [e.values["reason"] for e in run.events("request_refused")] == ["unstable_payload"]


def test_a_force_gain_under_which_the_payload_would_swing_the_tool_is_refused():
    """Soft environments allow great gains; the payload's own force bounds them as well."""
    cell = laden(5.0)
    soft = altered(cell, {"mechanism.force_torque.stiffest_environment": 100.0})
    on = {"at_s": 0.2, "operator/switch": {"source": "force", "on": True}}
    gain = {"at_s": 0.3, "operator/gain": {"source": "force", "gain": [0.02] * 3 + [0.0] * 3}}
    run = played(soft, (0.0, 0.0, 0.0), 0.3, on, gain)
    assert [e.values["reason"] for e in run.events("request_refused")] == ["unstable_gain"]
    assert "5.98 kg" in run.events("request_refused")[0].detail
