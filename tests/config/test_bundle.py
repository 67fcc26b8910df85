"""A cell as one text: the same cell again, without any of its files."""

import json

import pytest
from telerobot.config.bundle import from_text, to_text
from telerobot.config.errors import ConfigError
from telerobot.config.load import load_cell, shipped


@pytest.mark.parametrize("name", shipped("cells"))
def test_a_cell_is_the_same_again(name, tmp_path):
    cell = load_cell(name)
    again = from_text(to_text(cell), tmp_path)
    assert again.joint_tasks == cell.joint_tasks
    for then, now in zip(cell.parts, again.parts, strict=True):
        assert now.config.model_dump() == then.config.model_dump()
        assert now.config.keeps_clear == then.config.keeps_clear
        assert now.robot.joints == then.robot.joints
        assert now.robot.description() == then.robot.description()
        assert (now.prefix, now.place, now.task) == (then.prefix, then.place, then.task)


@pytest.mark.parametrize(
    "change",
    [
        lambda table: table.pop("parts"),
        lambda table: table.update(format=2),
        lambda table: table["parts"][0]["config"].update(unknown=1),
        lambda table: table["parts"][0].update(urdf="<robot"),
    ],
)
def test_a_text_that_is_no_cell_is_refused_in_one_line(change, tmp_path):
    table = json.loads(to_text(load_cell("pa10")))
    change(table)
    with pytest.raises(ConfigError) as refused:
        from_text(json.dumps(table), tmp_path)
    assert "\n" not in str(refused.value)
