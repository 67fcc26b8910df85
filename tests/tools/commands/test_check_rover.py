"""Wheels, sweep, scanner and contour of a cell: what is wrong is an error with value and bound."""

import math

import pytest
from telerobot.config.load import HERE, altered, load_cell
from telerobot.tools.checks.cell import bus_load, worst_case_bits
from telerobot.tools.checks.findings import Severity
from telerobot.tools.checks.judge import judge
from telerobot.tools.checks.rover import own_rays, sight, sweep, wheels

OF_A_ROVER = (bus_load, wheels, sweep, sight, own_rays)
CHECKS = {
    "base": wheels, "sweep": sweep, "scanner": sweep, "sight": sight, "self": own_rays,
    "contour": own_rays,
}  # fmt: skip


@pytest.fixture
def changed(tmp_path):
    """Return the findings about `rover_bridge` in which some lines read otherwise."""

    def found(*lines, checks=OF_A_ROVER):
        text = (HERE / "cells/rover_bridge.toml").read_text()
        for before, after in lines:
            assert before in text
            text = text.replace(before, after)
        path = tmp_path / "cell.toml"
        path.write_text(text)
        cell = load_cell(path)
        return {f.check: f for check in checks for f in check(cell)}

    return found


def test_the_shipped_rover_is_fine_in_all_of_it(changed):
    assert {f.status for f in changed().values()} == {Severity.OK}


def test_a_plain_arm_has_none_of_it():
    assert not {"base wheels", "sight near", "self margin"} & {
        f.check for f in judge(load_cell("pa10"))
    }


def test_wheels_and_tilt_load_the_bus_like_every_drive(changed):
    """Two wheels at speeds, seven joints and the tilt: 6 bytes there and 8 back, each."""
    cyclic = (worst_case_bits(0) + 10 * (worst_case_bits(6) + worst_case_bits(8))) / 0.01
    heartbeats = 11 * worst_case_bits(1) / 0.05
    assert changed(checks=[bus_load])["bus load"].values["load"] == pytest.approx(
        (cyclic + heartbeats) / 1e6
    )


def test_the_highest_cell_is_lost_where_the_sweep_ends(changed):
    """Closed form: the scanner's mirror, 60 mm beside the tilt's axis, looks up by 1.2 rad."""
    x, z = 0.35 - 0.06 * math.sin(1.2), 0.25 + 0.06 * math.cos(1.2)
    highest = 0.5 + 1.0 - 0.025
    lost = x + (highest - z) / math.tan(1.2) - 0.2
    assert changed(checks=[sight])["sight near"].values["nearest"] == pytest.approx(lost, abs=0.05)


ROWS = {
    "axles that are elsewhere": (
        ("radius = 0.12", "radius = 0.10"), "base wheels", {"off": 0.2, "limit": 0.05}),
    "a Base that is no higher than its wheels say": (
        ("rated_payload = 3.0", "rated_payload = 3.0\nT_world_base = { xyz = [0, 0, 0.03] }"),
        "base wheels", {"urdf_radius": 0.15, "off": 0.25}),
    "a speed that no wheel turns at": (
        ("speed = 0.5\nangular", "speed = 0.9\nangular"), "base speed",
        {"straight": 7.5, "max_velocity": 6.5}),
    "a sweep that the drive cannot follow": (
        ("period_s = 2.03", "period_s = 0.8"), "sweep speed", {"rate": 3.25, "limit": 2.7}),
    "a scanner beside the axis": (
        ('link = "head"', 'link = "chassis"'), "sweep scanner", {"link": "chassis"}),
    "more rays than a turn has": (
        ('link = "head"', 'link = "head"\nrays = 800'), "scanner rays",
        {"span": math.radians(399.5), "limit": 2 * math.pi}),
    "silence between any two contours": (
        ('link = "head"', 'link = "head"\nsilent_s = 0.05'), "scanner silence",
        {"silent_s": 0.05, "least": 0.08}),
    "a sweep that does not look up enough": (
        ("low = -1.2", "low = -0.6"), "sight near", {"limit": 0.95, "dead": 0}),
    "a sweep that looks at the floor": (
        ("low = -1.2", "low = -0.1"), "sight near", {"limit": 0.95}),
    "rays to one side": (
        ('link = "head"', 'link = "head"\nrays = 300'), "sight near", {"limit": 0.95}),
    "cells that a sweep does not fill": (
        ("cell = 0.05", "cell = 0.036"), "sight far", {"ahead": 2.0}),
    "cells without an inside": (
        ("width = 2.0, height = 1.0, cell = 0.05", "width = 0.8, cell = 0.024"), "sight far",
        {"cell": 0.024, "limit": 0.024}),
    "a margin within the noise": (
        ("self_margin = 0.04", "self_margin = 0.02"), "self margin",
        {"self_margin": 0.02, "least": 0.024}),
    "a margin that takes the bridge for the arm": (
        ("self_margin = 0.04", "self_margin = 0.06"), "self margin",
        {"self_margin": 0.06, "most": 0.05}),
    "housings wider than told": (
        ("link_radius = 0.06", "link_radius = 0.05"), "contour radius", {"least": 0.06}),
    "a plane that the arm sticks out of": (
        ("height = 1.0", "height = 0.7"), "contour plane", {"height": 0.7}),
    "a plane narrower than the base": (
        ("base_width = 0.6", "base_width = 2.5"), "contour plane", {"wide": 2.5}),
}  # fmt: skip


@pytest.mark.parametrize("name", ROWS)
def test_a_mistake_is_an_error_with_value_and_bound(changed, name):
    line, check, values = ROWS[name]
    found = changed(line, checks=[CHECKS[check.split()[0]]])[check]
    assert found.status is Severity.ERROR, found.text
    for key, value in values.items():
        assert found.values[key] == pytest.approx(value), key


def test_wheels_that_were_swapped_are_told(changed):
    swapped = 'left = "wheel_right", right = "wheel_left"'
    found = changed(('left = "wheel_left", right = "wheel_right"', swapped), checks=[wheels])
    found = found["base wheels"]
    assert found.status is Severity.ERROR
    assert found.values["urdf_track"] == pytest.approx(-0.5)


def test_a_base_that_is_not_midway_between_its_wheels_is_told(changed, tmp_path):
    urdf = load_cell("rover_bridge").robot.urdf.read_text()
    assert '<origin xyz="0 0.25 0.12"/>' in urdf
    for y in ("0.25 0.12", "-0.25 0.12"):
        urdf = urdf.replace(f'<origin xyz="0 {y}"/>', f'<origin xyz="-0.1 {y}"/>')
    (tmp_path / "aft.urdf").write_text(urdf)
    found = changed(('urdf = "rover_scan"', 'urdf = "./aft.urdf"'), checks=[wheels])["base wheels"]
    assert found.status is Severity.ERROR
    assert found.values["off"] == pytest.approx(0.2)


def test_wheels_that_skid_and_have_no_slip_factor_are_told(tmp_path):
    """Closed form: axles 0.4 m apart on a track of 0.5 m."""
    skids = load_cell("rover_skid")
    found = {f.check: f for f in wheels(skids)}
    assert {f.status for f in found.values()} == {Severity.OK}
    assert found["base skid"].values["expected"] == pytest.approx(1.64)
    rolls = altered(skids, {"mechanism.base.wheels.slip_factor": 1.0})
    assert {f.check: f for f in wheels(rolls)}["base skid"].status is Severity.WARN
    urdf = skids.robot.urdf.read_text()
    assert 'xyz="-0.2 0.25 0.12"' in urdf
    (tmp_path / "bent.urdf").write_text(urdf.replace("-0.2 0.25 0.12", "-0.2 0.30 0.12"))
    path = tmp_path / "cell.toml"
    path.write_text('extends = "rover_skid"\n[mechanism]\nurdf = "./bent.urdf"')
    assert next(f for f in wheels(load_cell(path))).status is Severity.ERROR


def test_an_arm_in_the_scanners_view_hides_cells(changed):
    posture = "ready = [0.0, 0.9, 0.0, 1.2, 0.0, 0.0, 0.0]"
    line = ("ready = [0.0, -0.7854, 0.0, 1.5708, 0.0, 0.7854, 0.0]", posture)
    assert changed(line, checks=[sight])["sight hidden"].values["hidden"] > 60
    assert changed(checks=[sight])["sight hidden"].values["hidden"] < 40
