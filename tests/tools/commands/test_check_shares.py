"""What `check` says of arms on one payload: what each of them bears, and what its sensor reads."""

import numpy as np
import pytest
from telerobot.config.load import HERE, load_cell
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.tools.checks.drives import holding
from telerobot.tools.checks.findings import Severity
from telerobot.tools.checks.loops import joint_tasks


@pytest.fixture
def pair(tmp_path):
    """Return findings about the pair with a payload [kg] and what the left arm's share costs."""

    def make(mass, dear, com="[0.0, 0.0, 0.0]", more=""):
        text = (HERE / "cells/pa10_pair.toml").read_text()
        text = text.replace("mass = 5.0, com = [0.0, 0.0, 0.0]", f"mass = {mass}, com = {com}")
        text = text.replace("shares = [[1.0, 1.0, 1.0, 1.0, 1.0, 1.0]", f"shares = [{[dear] * 6}")
        text = text.replace("[mechanisms.postures]", f"{more}[mechanisms.postures]", 1)
        path = tmp_path / "pair.toml"
        path.write_text(text)
        return {f.check: f for f in joint_tasks(load_cell(path))}

    return make


def test_a_mass_within_the_sum_of_ratings_is_an_error_where_one_arm_bears_all_of_it(pair):
    found = pair(20.0, 1000.0)
    assert found["beam.left.payload"].status is Severity.OK
    assert found["beam.right.payload"].status is Severity.ERROR
    assert found["beam.right.payload"].values["mass_kg"] == pytest.approx(20.0, abs=0.1)
    assert found["beam.right.holding"].status is Severity.ERROR
    assert found["beam.right.reading"].status is Severity.ERROR


def test_equal_shares_of_twice_one_arms_rating_are_borne(pair):
    found = pair(19.9, 1.0)
    assert [found[f"beam.{side}.payload"].status for side in ("left", "right")] == [Severity.OK] * 2
    assert found["beam.left.payload"].values["mass_kg"] == pytest.approx(9.95)


def test_a_share_beyond_a_sensors_range_is_an_error_by_axis(pair):
    found = pair(10.4, 3.0)
    right = found["beam.right.reading"]
    assert right.status is Severity.ERROR
    assert right.values["axis"] == "Tx"
    assert right.values["share"] == pytest.approx(17.2 / 16.3835, rel=0.01)
    assert found["beam.right.payload"].status is Severity.OK
    assert found["beam.left.reading"].status is Severity.OK


def test_the_tools_own_weight_is_in_the_reading(pair):
    """A share of 93 N is within 150 N, and is not with a tool of 97 N."""
    narrow = "measuring_range = [150.0, 150.0, 150.0, 15.0, 15.0, 15.0]\n"
    tool = "payload = { mass = 9.9, com = [0.0, 0.0, 0.05] }\n"
    fits = pair(19.0, 1.0, more=f"[mechanisms.force_torque]\n{narrow}")
    heavy = pair(19.0, 1.0, more=f"[mechanisms.force_torque]\n{narrow}{tool}")
    assert fits["beam.left.reading"].status is Severity.WARN
    assert heavy["beam.left.reading"].status is Severity.ERROR
    assert heavy["beam.left.reading"].values["axis"] == "Fz"


def test_what_holds_a_share_is_what_the_drives_do_in_the_physics(pair):
    """8.7 kg in shares of 1 : 3 take 59.7 N·m of the right arm's e1, 1 N·m of it for friction."""
    right = pair(8.7, 3.0)["beam.right.holding"]
    assert right.values["joint"] == "e1"
    assert right.values["share"] * 115.0 == pytest.approx(59.7, abs=2.0)


def test_a_tool_is_too_heavy_for_the_sensor_at_the_postures_or_elsewhere(small):
    def reading(com, mass):
        tool = f"rate_hz = 200\npayload = {{ mass = {mass}, com = {com} }}\n"
        small.replace("rate_hz = 200\n", tool)
        found = next(f for f in holding(load_cell(small.cell)) if "reading" in f.check)
        small.replace(tool, "rate_hz = 200\n")
        return found

    cell = load_cell(small.cell)
    q = np.array(cell.config.mechanism.postures["ready"])
    up = Mechanism.from_cell(cell).pose_wrist(q).R[2]
    along = [round(float(x), 6) for x in 0.4 * up]
    assert reading([0.0, 0.0, 0.0], 5.0).status is Severity.OK
    assert reading([0.0, 0.0, 0.0], 80.0).status is Severity.ERROR
    # it hangs below the sensor at `ready`, and leans out to 19.6 N·m elsewhere
    assert reading(along, 5.0).status is not Severity.OK
