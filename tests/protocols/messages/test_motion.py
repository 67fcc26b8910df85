import math

import pytest
from telerobot.protocols import topics as t
from telerobot.protocols.codec import CodecError, decode, encode
from telerobot.protocols.messages.messages import MOST, PathMotion

ENVELOPE = {"seen_tick": 2**40}
POSE = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)


def refused(topic, **fields):
    message = topic.message.model_construct(**{**ENVELOPE, **fields})
    with pytest.raises(CodecError) as caught:
        decode(topic, encode(message))
    return caught.value.detail


def test_the_longest_path_fits_its_topic():
    path = PathMotion(**ENVELOPE, waypoints=(POSE,) * MOST, speeds=(0.1,) * MOST)
    assert decode(t.PATH, encode(path)) == path
    twists = PathMotion(**ENVELOPE, twists=(POSE,) * MOST, durations_s=(0.1,) * MOST)
    assert decode(t.PATH, encode(twists)) == twists


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"waypoints": (POSE,) * (MOST + 1)}, "waypoints"),
        ({"waypoints": ()}, "either waypoints or twists"),
        ({"waypoints": (POSE,), "twists": (POSE,), "durations_s": (1.0,)}, "either"),
        ({"waypoints": (POSE, POSE), "speeds": (0.1,)}, "1 speeds for 2 waypoints"),
        ({"twists": (POSE,)}, "0 durations for 1 twists"),
        ({"twists": (POSE,), "durations_s": (0.0,)}, "durations_s[0]"),
        ({"waypoints": (POSE,), "speeds": (0.0,)}, "speeds[0]"),
        ({"waypoints": ((*POSE[:5], math.nan),)}, "waypoints[0]"),
        ({"waypoints": (POSE[:5],)}, "waypoints[0]"),
        ({"waypoints": (POSE,), "blend": -0.1}, "blend"),
    ],
)
def test_a_path_that_is_none_is_refused_by_name(fields, words):
    assert words in refused(t.PATH, **fields)


def test_postures_are_for_their_objective_and_objectives_have_plain_names():
    words = refused(t.REDUNDANCY, objective="mid_range", gain=1.0, posture="ready")
    assert "objective posture" in words
    assert "objective" in refused(t.REDUNDANCY, objective="Beauty!", gain=1.0)


def test_scales_are_bounded():
    assert "translation" in refused(t.CLUTCH, translation=-1.0)
    assert "rotation" in refused(t.CLUTCH, rotation=100.0)
