"""A changed copy is what dataclasses.replace would make."""

from dataclasses import dataclass, replace

import pytest
from telerobot.server.control.compiled import evolve


@dataclass(frozen=True)
class Thing:
    a: int
    b: str = "b"


def test_a_changed_copy_equals_that_of_the_standard_library_and_leaves_the_first_alone():
    first = Thing(1)
    assert evolve(first, b="c") == replace(first, b="c") == Thing(1, "c")
    assert first == Thing(1)
    assert type(evolve(first)) is Thing


def test_a_field_that_there_is_not_is_refused_by_name():
    with pytest.raises(TypeError, match="Thing has no field c"):
        evolve(Thing(1), c=2)
