"""A snake goes between boxes through a tunnel that was found, and touches none of them."""

import numpy as np
from telerobot.config.load import load_cell
from telerobot.server.control.backbone.fit import Chain
from telerobot.tools.simulation.simulation import simulate


def test_it_goes_to_the_end_and_back_and_keeps_as_clear_of_boxes_as_was_said():
    cell, run = load_cell("snake_boxes"), simulate("snake_boxes")
    assert run.ok
    assert run.summary["wall_force_n"] == 0.0
    tips = max(s.insertion["depth"] for s in run.states if s.insertion)
    assert tips > 0.735
    # The search said 28.8 mm.
    links = Chain.from_cell(cell).points(np.array([truth.q for truth in run.truths[::5]]))
    points = np.concatenate((links, 0.5 * (links[:, 1:] + links[:, :-1])), axis=1).reshape(-1, 3)
    radius = cell.config.mechanism.backbone.link_radius
    least = min(
        float(np.linalg.norm(np.maximum(np.abs(points - o.xyz) - o.half_size, 0.0), axis=1).min())
        for o in cell.config.obstacles
    )
    assert least - radius > 0.028


def test_without_a_tunnel_it_runs_into_the_first_shelf(play):
    go = {"at_s": 0.2, "cmd/insert": {"depth": 0.30}}
    run = play(go, seconds=5.0, cell=load_cell("snake_boxes"))
    assert run.summary["wall_force_n"] > 1.0
