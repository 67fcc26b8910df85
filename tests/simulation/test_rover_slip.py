"""A rover whose wheels turn while it stays behind: its scans tell, it stops, and it knows where."""

import numpy as np
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.rig import BoxSection
from telerobot.protocols.messages.rig import RigFault
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

SIDES = (
    BoxSection(name="left", xyz=(0.0, 2.0, 1.0), half_size=(30.0, 0.1, 1.0)),
    BoxSection(name="right", xyz=(0.0, -2.0, 1.0), half_size=(30.0, 0.1, 1.0)),
)
AHEAD = BoxSection(name="ahead", xyz=(4.0, 0.0, 1.0), half_size=(0.1, 2.0, 1.0))


def on_ice(boxes: tuple[BoxSection, ...], seconds: float) -> Simulation:
    """Return a run in which the base is driven ahead at 0.3 m/s, between walls and on ice."""
    cell = altered(load_cell("rover_bridge"), {"rig.bridge": None, "rig.boxes": boxes})
    drive = {"at_s": 0.3, "cmd/drive": {"rates": [0.3, 0.0]}}
    run = Simulation(cell, Script.model_validate({"duration_s": seconds, "step": [drive]}))
    for wheel in ("wheel_left", "wheel_right"):
        run.rig.inject(RigFault(kind="slip", target=wheel, value=0.005))
    return run


def odometry_off(run: Simulation) -> float:
    true, told = run.truths[-1].frames["base"], run.states[-1].frames["base"]
    return float(np.hypot(true[0] - told[0], true[1] - told[1]))


def test_a_base_that_stays_behind_its_wheels_stops_by_name_and_its_odometry_is_put_right() -> None:
    run = on_ice((*SIDES, AHEAD), seconds=5.5)
    result = run.run()
    (slip,) = [event for event in run.events if event.name == "wheels_slip"]
    (stop,) = [event for event in run.events if event.name == "stopping"]
    assert stop.values["reason"] == "wheels slip"
    assert stop.time_s - slip.time_s < 0.05
    assert slip.values["distance_m"] < 0.15
    assert result.summary["mode"] == "hold"
    assert result.summary["limit_violations"] == 0
    assert odometry_off(run) < 0.1  # 1.3 m where nobody looks
