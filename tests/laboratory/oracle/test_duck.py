"""The opening of a bridge as the search of other means has it, by the shapes of the physics."""

import mujoco
import numpy as np
import pytest
from laboratory.oracle.duck import gate_of
from telerobot.config.schema.rig import RigBridgeSection
from telerobot.drivers.rig.physics.bodies import add_bridge


@pytest.mark.parametrize("skew", [-0.3, -0.1, 0.0, 0.2, 0.3])
def test_the_opening_is_between_the_corners_of_the_pillars(skew: float) -> None:
    bridge = RigBridgeSection(
        height=1.0, width=1.0, thickness=0.4, side=0.1, skew=skew, offset=0.05, distance=2.0
    )
    spec = mujoco.MjSpec()
    add_bridge(spec, bridge)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    edges = []
    for name in ("bridge_left_box", "bridge_right_box"):
        shape = model.geom(name).id
        R, half = data.geom_xmat[shape].reshape(3, 3), model.geom_size[shape]
        corners = [
            (data.geom_xpos[shape] + R @ (half * np.array([a, b, 0.0])))[1]
            for a in (-1, 1)
            for b in (-1, 1)
        ]
        edges.append((min(corners), max(corners)))
    gate = gate_of(1.0, 1.0, 0.4, 0.1, skew, 0.05)
    assert gate.left == pytest.approx(edges[0][0])
    assert gate.right == pytest.approx(edges[1][1])
