"""Contact is told for each joint of the longest mechanism that a cell may have."""

import pytest
from pydantic import ValidationError
from telerobot.config.schema.mechanism import MOST_DRIVES, TouchSection


def test_each_joint_of_the_longest_arm_has_a_bound_of_its_own():
    torque = tuple(1.0 + 0.01 * i for i in range(MOST_DRIVES))
    assert TouchSection(torque=torque).torque == torque
    with pytest.raises(ValidationError, match=f"at most {MOST_DRIVES} items"):
        TouchSection(torque=(*torque, 1.0))
