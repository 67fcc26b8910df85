"""At torque level a hand pushes beside a command, and joints keep their greatest speed."""

import numpy as np
from laboratory.campaign import torques
from telerobot.config.load import load_cell
from telerobot.tools.simulation.simulation import Simulation


def test_a_hand_that_leads_and_turns_a_joint_at_its_top_speed_breaks_no_bound():
    simulation = Simulation(load_cell(torques.CELL), torques.script(100))
    result = simulation.run()
    most = [drive.max_velocity for drive in simulation.cell.config.mechanism.drives]
    asked = np.abs([state.dq_command for state in result.states]) / most
    assert simulation.observer.max_speed_ratio > 0.95
    assert asked.max() < 0.91
    assert result.summary["limit_violations"] == 0
    assert result.summary["mode"] == "enabled"
