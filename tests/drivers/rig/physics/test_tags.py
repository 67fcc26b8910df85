import pytest
from telerobot.config.load import load_cell
from telerobot.drivers.rig.physics.sensors import Tags
from telerobot.protocols.messages.rig import RigFault


@pytest.fixture
def tags():
    return Tags(load_cell("pa10_vision").config.rig.tags)


def test_a_tag_is_covered_and_uncovered(tags):
    tags.inject(RigFault(kind="cover", target="panel"))
    assert tags.covered == ("panel",)
    tags.inject(RigFault(kind="cover", target="panel", on=False))
    assert tags.covered == ()


def test_a_tag_is_moved_keeps_its_attitude_and_goes_home(tags):
    home = tags.poses["panel"]
    tags.inject(RigFault(kind="move", target="panel", vector=(1.0, 0.1, 0.5)))
    assert tags.poses["panel"] == (1.0, 0.1, 0.5, *home[3:])
    tags.inject(RigFault(kind="move", target="panel", on=False))
    assert tags.poses["panel"] == home


def test_a_tag_that_the_arm_carries_stands_nowhere_and_cannot_be_moved(tags):
    assert "hand" not in tags.poses
    with pytest.raises(ValueError, match="the arm carries tag hand"):
        tags.inject(RigFault(kind="move", target="hand", vector=(1.0, 0.0, 0.0)))


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (RigFault(kind="cover", target="j1"), "no tag 'j1'; there are panel, hand"),
        (RigFault(kind="move", target="panel"), "give its vector"),
    ],
)
def test_what_makes_no_sense_is_refused_in_words(tags, fault, words):
    with pytest.raises(ValueError, match=words):
        tags.inject(fault)
