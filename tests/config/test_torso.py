"""Mechanisms that stand on others: what cannot be is refused, with file and key."""

import numpy as np
import pytest
from telerobot.config.load import ConfigError, load_cell

TORSO = load_cell("pa10_torso").path.read_text()


def refused(cell, text):
    with pytest.raises(ConfigError) as found:
        cell(text)
    return "\n".join(found.value.messages)


def test_what_stands_on_a_torso_is_where_that_has_it_at_start():
    torso, left, right = load_cell("pa10_torso").parts
    assert left.config.mechanism.T_world_base.xyz == pytest.approx((0.0, 0.3, 0.8))
    assert right.config.mechanism.T_world_base.xyz == pytest.approx((0.0, -0.3, 0.8))
    assert load_cell("pa10_torso").carriers == (-1, 0, 0)
    assert np.allclose(left.config.mechanism.T_world_base.rpy, 0.0)
    assert torso.config.mechanism.T_world_base.xyz == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[mechanisms.torso]\nweight = [0.5, 1.0]", "", "on: value 'torso': has no [torso]"),
        ("weight = [0.5, 1.0]", "weight = [1, 1, 1]", "torso.weight: 3 values for 2 joints"),
        (
            "[mechanisms.torso]", "[mechanisms.touch]\ntorque = [9.0]\n\n[mechanisms.torso]",
            "touch: torques are judged by the loads of a mechanism alone",
        ),
        ('on = "torso"', 'on = "trunk"', "on: value 'trunk': no such mechanism"),
        ('on = "torso"', 'on = "right"', "on: value 'right': has no [torso]"),
        ('on = "torso"', 'on = "left"', "goes round in a circle: left on left"),
        (
            'like = "pa10"\nbus = "left"', 'like = "pa10_hand_torque"\nbus = "left"',
            "operation_mode: value 'cst': the torque law knows",
        ),
        (
            'on = "torso"\n', 'on = "torso"\nT_world_base = { xyz = [1, 0, 0] }\n',
            "T_world_base: stands on 'torso': give mechanisms[1].T_on",
        ),
    ],
)  # fmt: skip
def test_what_cannot_stand_on_another_is_told(cell, old, new, words):
    assert words in refused(cell, TORSO.replace(old, new, 1))


def test_what_carries_comes_right_before_what_it_carries(cell):
    head, torso, left, right = TORSO.split("[[mechanisms]]")
    right, rig = right.split("[rig]")
    told = refused(cell, "[[mechanisms]]".join((head, left, torso, right)) + "[rig]" + rig)
    assert "value 'left': what stands on 'torso' comes right after it" in told


def test_arms_on_a_torso_hold_no_payload_together_yet(cell):
    task = """
[[tasks]]
name = "beam"
by = ["left", "right"]
T_wrist_mrf = [{}, {}]
payload = { mass = 1.0 }
internal_stiffness = 50000.0
internal_stiffness_rotation = 1000.0
"""
    assert "shares joints with others" in refused(cell, TORSO + task)


def test_touch_is_switched_off_for_one_that_is_like_another(cell):
    alone = (
        TORSO.split("[[mechanisms]]")[0]
        + """[[mechanisms]]
name = "arm"
like = "pa10"
bus = "left"
touch = false
"""
    )
    assert cell(alone).config.touch is None
