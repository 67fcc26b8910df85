"""Other values of a cell are judged as a file's are: a misspelt key tests nothing unnoticed."""

import re
from pathlib import Path

import pytest
from pydantic import ValidationError
from telerobot.config.load import ConfigError, altered, load_cell

PA10 = load_cell("pa10")


def test_values_are_altered_by_their_keys_and_nothing_else_is():
    cell = altered(
        PA10,
        {
            "rig.wall.stiffness": 2000.0,
            "rig.boxes.0.name": "bench",
            "mechanism.postures.start": (0.0,) * 7,
            "rig.seed": 7,
        },
    )
    rig = cell.config.rig
    assert (rig.wall.stiffness, rig.boxes[0].name, rig.seed) == (2000.0, "bench", 7)
    assert cell.config.mechanism.postures["start"] == (0.0,) * 7
    assert cell.config.mechanism.postures["ready"] == PA10.config.mechanism.postures["ready"]
    assert altered(PA10, {"stiffness": 2000.0}, "rig.wall").config.rig.wall == rig.wall
    assert altered(cell, {"rig": PA10.config.rig, "mechanism": PA10.config.mechanism}) == PA10


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("rig.wall.stifness", 2000.0, "rig.wall.stifness: unknown key; did you mean 'stiffness'?"),
        ("rig.wal.stiffness", 2000.0, "unknown key"),
        ("rig.wall.stiffness", -1.0, "rig.wall.stiffness: value -1.0: "),
        ("rig.wall.normal", (0.0, 0.0, 0.0), "rig.wall.normal: value"),
        ("rig.wall.stiffness", "much", "value 'much'"),
        ("rig.boxes.9.xyz", (0.0, 0.0, 0.0), "9: no entry of"),
        ("rig.beam.mass", 5.0, "mass: there is no table around it"),
    ],
)
def test_what_is_not_there_or_may_not_be_is_named(key, value, words):
    with pytest.raises(ConfigError) as refused:
        altered(PA10, {key: value})
    assert words in str(refused.value)


@pytest.mark.parametrize("update", [{"stifness": 2000.0}, {"stiffness": -1.0}])
def test_a_copy_of_a_table_is_judged_as_well(update):
    with pytest.raises(ValidationError):
        PA10.config.rig.wall.model_copy(update=update)


def test_nothing_makes_a_table_that_was_not_judged():
    """Copies are; what goes past them is not to be used on cells, in tests and tools alike."""
    here = Path(__file__).resolve().parents[2]
    past = re.compile(r"(Section|CellConfig)\.model_construct\(|BaseModel\.model_copy\(")
    files = [
        f
        for folder in ("config", "server", "tools", "tests")
        for f in (here / folder).rglob("*.py")
    ]
    found = [
        f"{f.name}: {m.group()}"
        for f in files
        for m in past.finditer(f.read_text())
        if f != Path(__file__)
    ]
    assert len(files) > 100
    assert found == []
