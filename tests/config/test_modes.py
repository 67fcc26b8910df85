"""What drives in CST, the torque law and a hand need of a cell: one line that names the key."""

import pytest
from telerobot.config.errors import ConfigError
from telerobot.config.load import HERE, load_cell

HAND = (HERE / "cells" / "pa10_hand.toml").read_text(encoding="utf-8")
CST = HAND.replace('operation_mode = "csp"', 'operation_mode = "cst"')
LAG = "lag_s = 0.0"


@pytest.mark.parametrize(
    ("text", "old", "new", "expected"),
    [
        (HAND, '= "csp"', '= "pp"', "mechanism.operation_mode: value 'pp'"),
        (CST, "max_torque_rate = 9200.0\n", "", "mechanism.drives[0].max_torque_rate: missing"),
        (CST, "[rig]", "[frames.base]\n[rig]", "value 'cst': the law takes Base to stand"),
        (HAND, LAG, "friction = [1.0]", "torque.friction: unknown key"),
        (HAND, "lag_s = 0.0", "lag_s = 2", "torque.lag_s: value 2"),
        (HAND, "lag_s = 0.0", "lag = 0.01", "torque.lag: unknown key"),
        (HAND, "mass = 1.0", "mass = 0.0", "sources.following.mass: value 0.0"),
        (HAND, "mass = 1.0", "gain = [2, 1, 1, 0, 0, 0]", "sources.following.gain[0]: value 2"),
    ],
)
def test_a_mistake_is_one_line_that_names_the_key(tmp_path, text, old, new, expected):
    assert old in text
    path = tmp_path / "cell.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_cell(path)
    assert expected in str(caught.value)
    assert all(line.startswith("/") for line in str(caught.value).splitlines()), "a file, a line"


def test_one_line_switches_between_the_levels():
    rate, torque = load_cell("pa10_hand").config, load_cell("pa10_hand_torque").config
    assert torque.mechanism.operation_mode == "cst"
    same = torque.mechanism.model_copy(update={"operation_mode": "csp"})
    texts = {"name": rate.name, "description": rate.description}
    assert torque.model_copy(update={"mechanism": same, **texts}) == rate
