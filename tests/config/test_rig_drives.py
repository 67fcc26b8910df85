"""Virtual drives: what a cell says of them, and what follows from the arm's inertia."""

import math

import numpy as np
import pytest
from telerobot.config.load import ConfigError, load_cell
from telerobot.server.control.mechanism.model import Mechanism

KEYS = ("stiffness", "damping", "integral", "armature", "friction")


def without_drives(small):
    text = small.cell.read_text()
    small.cell.write_text(text[: text.index("[rig.drive]")] + "[rig]\n")
    return load_cell(small.cell)


def test_one_number_stands_for_a_list_of_equal_ones(small):
    listed = load_cell(small.cell).config.rig.drive
    small.replace("stiffness = [9000.0]", "stiffness = 9000\nbrake_torque = 12.5")
    plain = load_cell(small.cell).config.rig.drive
    assert plain.brake_torque == (12.5,)
    assert plain.model_copy(update={"brake_torque": ()}) == listed


@pytest.mark.parametrize(
    ("says", "told"),
    [
        ("stiffness = '9000'", "rig.drive.stiffness: value '9000'"),
        ("stiffness = true", "rig.drive.stiffness: value True"),
        ("stiffness = 0.0", "rig.drive.stiffness[0]: value 0.0: should be greater than 0"),
        ("brake_torque = [1.0, 2.0]", "rig.drive.brake_torque: 2 values: must be 1, or 3"),
    ],
)
def test_what_is_no_list_of_numbers_is_refused(small, says, told):
    small.replace("stiffness = [9000.0]", says)
    with pytest.raises(ConfigError, match=r"small\.toml: ") as caught:
        load_cell(small.cell)
    assert told in str(caught.value)


def test_drives_that_the_cell_does_not_tell_follow_the_arms_inertia(small):
    """All position loops are as quick and as damped, at the greatest inertia that a joint meets."""
    cell = without_drives(small)
    drive = cell.config.rig.drive
    assert all(len(getattr(drive, key)) == 3 for key in KEYS)
    K, D, rotor = (np.array(getattr(drive, k)) for k in ("stiffness", "damping", "armature"))
    mechanism = Mechanism.from_cell(cell)
    lower = np.array([joint.lower for joint in cell.robot.joints])
    upper = np.array([joint.upper for joint in cell.robot.joints])
    draw = np.random.default_rng(0)
    each = [np.diag(mechanism.mass_matrix(draw.uniform(lower, upper))) for _ in range(2000)]
    whole = np.max(each, axis=0) + rotor
    frequency = np.sqrt(K / whole)
    assert frequency.max() / frequency.min() < 1.1
    assert D / (2.0 * np.sqrt(K * whole)) == pytest.approx(0.8, abs=0.08)
    torques = {d.joint: d.max_torque for d in cell.config.mechanism.drives}
    assert drive.friction == pytest.approx([0.01 * torques[j] for j in cell.joints])


def test_drives_far_too_strong_for_their_arm_break_loose_within_two_thousandths(small):
    """URDFs of hobby servos state 1,000 N·m: a hundredth of that would hold the whole arm."""
    small.replace("max_torque = ", "max_torque = 1e4  # ")
    drive = without_drives(small).config.rig.drive
    off = np.array(drive.friction) / np.array(drive.stiffness)
    assert (off <= 2.01e-3).all()
    assert (off > 1e-3).all(), "they do have friction"


def test_what_the_cell_tells_of_its_drives_stands_beside_what_follows(small):
    follows = without_drives(small).config.rig.drive
    small.cell.write_text(small.cell.read_text() + "[rig.drive]\nfriction = 2.5\n")
    told = load_cell(small.cell).config.rig.drive
    assert told.friction == (2.5,)
    assert told.stiffness == follows.stiffness
    assert all(map(math.isfinite, told.stiffness))
