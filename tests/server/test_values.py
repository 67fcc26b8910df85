"""Recorded values: the same again, to the last bit and with the same memory layout."""

from pathlib import Path

import msgpack
import numpy as np
import pytest
from telerobot.protocols.messages.messages import Frame
from telerobot.server.control.inputs import Intent, PathGoal, Route
from telerobot.server.control.scene import empty
from telerobot.server.control.spatial import Motion, Pose
from telerobot.server.control.stop.trajectory import PositionPlanner
from telerobot.server.recorder import RecordedValueError, pack, unpack

POSE = Pose.from_xyz_rpy((0.1, 0.2, 0.3), (0.4, 0.5, 0.6))


@pytest.mark.parametrize(
    "value",
    [
        None,
        (1, 2.5, "x", b"y", True),
        [1, [2]],
        {("a", "b"): 1.0, "c": (None,)},
        np.float64(0.1),
        np.bool_(True),
        Intent.HOLD,
        POSE,
        Route((PathGoal(POSE, 1), PathGoal(POSE.inverse(), 2, speed=0.1)), 7),
        empty(),
    ],
)
def test_a_value_is_the_same_again(value):
    again = unpack(pack(value))
    assert type(again) is type(value)
    assert pack(again) == pack(value)


@pytest.mark.parametrize(
    "array",
    [
        np.arange(12.0).reshape(3, 4),
        np.arange(12.0).reshape(3, 4).T,
        np.arange(12.0).reshape(3, 4)[:, 1],
        np.arange(24.0).reshape(2, 3, 4)[:, ::2],
        np.zeros((0, 3)),
        np.array(2.0),
        np.array([True, False]),
        np.array([np.nan, -0.0, np.inf]),
    ],
)
def test_an_array_keeps_its_bits_and_its_layout(array):
    again = unpack(pack(array))
    assert again.tobytes() == array.tobytes()
    assert again.shape == array.shape
    assert again.strides == array.strides or array.size == 0


def test_a_planned_motion_goes_on_where_it_was():
    start = Motion.at_rest(np.zeros(6))
    bounds = (np.full(6, 0.2), np.full(6, 1.0), np.full(6, 10.0))
    profile = PositionPlanner(6).plan(start, np.linspace(0.1, 0.6, 6), bounds).advanced(0.37)
    again = unpack(pack(profile))
    for ahead_s in (0.0, 0.5, 2.0):
        assert again.at(ahead_s).q.tobytes() == profile.at(ahead_s).q.tobytes()


def test_a_foreign_object_is_not_recorded():
    with pytest.raises(TypeError, match="cannot be recorded"):
        pack(Path())


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xc1",
        pack((1, 2))[:-1],
        msgpack.packb([4, "state:Inputs", 1]),
        msgpack.packb([4, "..runtime.events:Events"]),
        msgpack.packb([4, "state:np"]),
        msgpack.packb([5, "state:Intent", "FLY"]),
        msgpack.packb([99]),
    ],
)
def test_bytes_that_are_no_value_are_refused(data):
    with pytest.raises(RecordedValueError):
        unpack(data)


def test_a_frame_s_name_from_a_message_is_its_text():
    assert unpack(pack((Frame.BASE,))) == ("base",)
