"""A drive that tells of its fault between two ticks: the others stop with the next SYNC."""

import pytest
from telerobot.protocols.messages.rig import RigFault
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import STICK


@pytest.mark.parametrize("after_sync", [4, 9])
def test_all_drives_stop_with_the_sync_after_an_emergency(pa10, after_sync):
    move = {"at_s": 0.0, "for_s": 1.0, "cmd/joystick": STICK}
    simulation = Simulation(pa10, Script.model_validate({"duration_s": 0.8, "step": [move]}))
    seen, found = [], []

    def on_physics(simulation):
        seen.append(simulation.rig.truth().drives)
        moving = abs(simulation.rig.world.dq).max() > 0.05
        # 10 steps are a period, which begins with its SYNC
        if moving and not found and len(seen) % 10 == after_sync:
            simulation.rig.inject(RigFault(kind="fault", target="e1"))
            found.append(len(seen))

    simulation.on_physics = on_physics
    result = simulation.run()
    s1 = [drives[pa10.joints.index("s1")] for drives in seen[found[0] :]]
    assert s1.index("quick_stop_active") == 10 - after_sync
    assert result.summary["mode"] == "fault"
    (event,) = [e for e in simulation.events if e.name == "fault"]
    assert event.values["device"] == "e1"
    assert result.summary["limit_violations"] == 0
