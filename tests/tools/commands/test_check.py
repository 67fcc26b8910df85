import json
import math
import re

import numpy as np
import pytest
from telerobot.config.load import HERE, altered, load_cell, shipped
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.stability.loops import bound, filter_periods, jerk_lag_s
from telerobot.tools.checks.cell import worst_case_bits
from telerobot.tools.checks.drives import drives
from telerobot.tools.checks.findings import Severity, failed
from telerobot.tools.checks.judge import judge
from telerobot.tools.cli import main


def findings(path):
    return {f.check: f for f in judge(load_cell(path))}


def errors(path):
    return [name for name, f in findings(path).items() if f.status is Severity.ERROR]


@pytest.mark.parametrize("name", shipped("cells"))
def test_every_shipped_cell_passes_and_its_joints_feel_contact(name):
    """But for those of a torso: what it bears is not its own load alone."""
    found = judge(load_cell(name))
    assert not failed(found)
    unfelt = [f.check for f in found if f.check.endswith("contact") and f.status is Severity.WARN]
    assert unfelt == ["torso.contact"] * (name == "pa10_torso")


def test_a_sound_cell_passes_and_says_so(small, capsys):
    assert main(["check", str(small.cell)]) == 0
    assert capsys.readouterr().out.splitlines()[-1].endswith("0 errors, 0 warnings")


def test_json_holds_every_finding_with_its_numbers(small, capsys):
    small.replace("max_torque = 80.0", "max_torque = 180.0")
    assert main(["check", str(small.cell), "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["cell"] == "small"
    assert report["ok"] is False
    torque = next(f for f in report["findings"] if f["check"] == "j2 torque")
    assert torque["status"] == "error"
    assert torque["values"]["urdf"] == 100.0


def test_a_frames_worst_case_is_the_known_one():
    assert [worst_case_bits(n) for n in (0, 1, 6, 8)] == [55, 65, 115, 135]


def test_the_bus_load_is_that_of_the_frames(small):
    cyclic = (55 + 3 * (115 + 135)) / 0.01
    expected = (cyclic + 4 * 65 / 0.05 + 2 * 135 * 200) / 1e6
    assert findings(small.cell)["bus load"].values["load"] == pytest.approx(expected)


def test_a_bus_that_is_too_slow_is_an_error(small):
    small.cell.write_text(small.cell.read_text() + "\n[bus]\nbitrate = 125000\n")
    assert errors(small.cell) == ["bus load"]


@pytest.mark.parametrize(
    ("timing", "check"),
    [
        ("setpoint_timeout_s = 0.04", "timeouts"),
        ("heartbeat_timeout_s = 0.08", "timeouts"),
        ("lease_timeout_s = 0.2", "timeouts"),
        ("tolerated_overruns = 1", "timeouts"),
        ("heartbeat_period_s = 0.15", "heartbeat watch"),
        ("heartbeat_period_s = 0.005", "heartbeat period"),
        ("stream_timeout_s = 0.015", "stream watch"),
    ],
)
def test_timeouts_out_of_order_are_an_error(small, timing, check):
    assert check in errors(small.replace("period_s = 0.01\n", f"period_s = 0.01\n{timing}\n"))


def test_halves_of_two_samples_must_not_look_like_one(small):
    small.replace("rate_hz = 200", "rate_hz = 1000\npairing_window_s = 0.004")
    assert "sample halves" in errors(small.cell)


def test_a_margin_that_a_sagging_joint_uses_up_is_warned_of(small):
    found = findings(small.replace("max_jerk = 200.0", "max_jerk = 200.0\nposition_margin = 0.001"))
    assert found["enabling at a limit"].status is Severity.WARN
    assert found["enabling at a limit"].values["position_margin"] == 0.001


def test_a_drive_that_ramps_down_longer_than_it_is_given_to_switch_off_is_an_error(small):
    path = small.replace("max_jerk = 200.0", "max_jerk = 200.0\nquick_stop_deceleration = 0.5")
    found = findings(path)["switching off"]
    assert found.status is Severity.ERROR
    assert found.values["ramp_s"] > found.values["patience_s"] == 1.0


def test_an_encoder_too_coarse_for_the_jerk_bound_is_an_error(small):
    # 4 / (10^4 · 10^-6) = 400 rad/s³ of apparent jerk against a bound of 200
    found = findings(small.replace("2670176.8", "10000.0"))["j1 encoder"]
    assert found.status is Severity.ERROR
    assert found.values["apparent_jerk"] == pytest.approx(400.0)


def test_a_torque_that_6077h_cannot_tell_is_an_error(small):
    assert "j1 torque" in errors(small.replace("rated_torque = 40.0", "rated_torque = 1.0"))


def test_a_weak_quick_stop_is_a_warning(small):
    small.replace("max_acceleration = 10.0", "max_acceleration = 20.0")
    assert findings(small.cell)["j1 stops"].status is Severity.WARN


def grows(gain, delay, ticks=6000):
    """Simulate x[k+1] = x[k] − gain · x[k − delay]; return whether it diverges."""
    x = [1.0] * (delay + 1)
    for _ in range(ticks):
        x.append(x[-1] - gain * x[-1 - delay])
    return not max(map(abs, x[-50:])) < 1.0


@pytest.mark.parametrize("delay", [0, 1, 2, 3, 4])
def test_the_stability_bound_is_where_the_sampled_loop_starts_to_grow(delay):
    assert not grows(0.97 * bound(delay), delay)
    assert grows(1.03 * bound(delay), delay)


def test_the_filters_delay_is_that_of_the_ticks_filter():
    period, cutoff = 0.01, 40.0
    share = 1.0 - math.exp(-2 * math.pi * cutoff * period)
    y, ramp = 0.0, 0
    for ramp in range(200):
        y += share * (ramp - y)
    assert filter_periods(cutoff, period) == pytest.approx(ramp - y)


@pytest.mark.parametrize("step", [0.01, 4.0])
def test_the_jerk_limits_lag_is_the_area_between_step_and_profile(step):
    acceleration, jerk = 2.0, 40.0
    peak = min(acceleration, math.sqrt(step * jerk))
    rise, flat = peak / jerk, step / peak - peak / jerk
    t = np.linspace(0.0, 2 * rise + flat, 200_001)
    slope = np.minimum(np.minimum(jerk * t, peak), jerk * (t[-1] - t))
    lag = float(np.trapezoid(step - np.cumsum(slope) * (t[1] - t[0]), t)) / step
    assert jerk_lag_s(step, acceleration, jerk) == pytest.approx(lag, rel=1e-3)


def test_a_force_gain_too_high_for_the_wall_is_an_error(small):
    sound = findings(small.cell)["force gain x"]
    assert sound.status is Severity.OK
    assert sound.values["loop_gain"] == pytest.approx(7e-4 * 20_000 * 0.01)
    assert "force gain x" in errors(small.replace("gain = [7e-4, 7e-4", "gain = [3e-3, 7e-4"))


def test_every_part_of_the_delay_is_stated(small):
    values = findings(small.cell)["force gain x"].values
    parts = [v for k, v in values.items() if k.startswith("delay_") and k != "delay_periods"]
    assert len(parts) == 6
    assert sum(parts) == pytest.approx(values["delay_periods"])


def test_a_lower_jerk_bound_counts_as_delay(small):
    before = findings(small.cell)["force gain x"].values["delay_jerk_limit"]
    after = findings(small.replace("max_jerk = 200.0", "max_jerk = 50.0"))["force gain x"]
    assert after.values["delay_jerk_limit"] == pytest.approx(2 * before)


def test_a_gain_that_pushes_on_is_an_error(small):
    assert "force gain x" in errors(small.replace("gain = [7e-4", "gain = [-7e-4"))


def test_a_stiff_rotation_counts(small):
    small.replace("rate_hz = 200", "rate_hz = 200\nstiffest_environment_rotation = 1e5")
    # base yaw and the two pitching joints: only those rotations exist
    assert any(name.startswith("force gain r") for name in errors(small.cell))


def test_without_a_sensor_there_is_no_force_loop_to_judge(small):
    small.replace("[mechanism.force_torque]\nrate_hz = 200\n", "")
    found = findings(small.cell)
    assert "force gain" in found
    assert "force gain x" not in found


def test_a_start_posture_in_a_singularity_is_an_error(tmp_path):
    text = load_cell("pa10").path.read_text()
    upright = re.sub(r"^start = .*$", f"start = {[0.0] * 7}", text, flags=re.MULTILINE)
    assert upright != text
    cell = tmp_path / "upright.toml"
    cell.write_text(upright)
    assert errors(cell) == ["posture start"]


def test_a_urdf_that_the_kinematics_refuses_is_one_line(small, monkeypatch, capsys):
    def refuse(*_arguments):
        raise ValueError("first line\nsecond line")

    monkeypatch.setattr(Mechanism, "__init__", refuse)
    assert main(["check", str(small.cell)]) == 2
    assert capsys.readouterr().err == f"telerobot: {small.urdf}: first line second line\n"


@pytest.mark.parametrize(
    ("old", "new", "check", "value"),
    [
        ("node = 1", "node = 1\nquick_stop_deceleration = 1e-5", "j1 stops", "1.5e+05 s"),
        ("max_jerk = 200.0", "max_jerk = 0.1", "j1 stops", "7.75 s"),
        ("max_acceleration = 10.0", "max_acceleration = 0.1", "j1 stops", "15 s"),
        ("max_torque = 80.0", "max_torque = 1e-3", "holding start", "of 0.001 N·m"),
    ],
)
def test_a_drive_that_could_not_stop_or_hold_the_arm_is_an_error(small, old, new, check, value):
    small.cell.write_text(small.cell.read_text().replace(old, new))
    found = findings(small.cell)[check]
    assert found.status is Severity.ERROR
    assert value in found.text


def test_the_heaviest_declared_payload_has_to_be_held(small):
    text = small.cell.read_text()
    small.cell.write_text(
        text.replace("[rig.drive]", "[mechanism.payloads]\nanvil = { mass = 60.0 }\n[rig.drive]")
    )
    found = findings(small.cell)["holding start"]
    assert found.status is Severity.ERROR
    assert found.text.endswith("with payload anvil")


def test_what_sensor_keys_can_do_is_told_in_numbers():
    found = findings("pa10_platform")
    base = found["news of base"]
    assert base.status is Severity.OK
    assert base.values["speed"] == 0.3
    assert base.values["acceleration"] == 0.5
    assert base.values["extent"] == 0.5
    # 0.98 kg at 0.35 rad: the sine of the weight, and the mass times the acceleration.
    assert base.values["force"] == pytest.approx(0.98 * (9.81 * 0.3482 + 0.5), rel=0.03)
    assert base.values["tool_speed"] == 0.5  # with its lever more, but for the bound of the tool
    assert "moves no idle arm" in found["news of obstacles"].text
    assert findings("ranger")["news of obstacles"].values["self_motion"] > 0.0
    assert "until a view is stored" in findings("pa10_vision")["pictures"].text


def test_joints_that_feel_no_contact_are_worth_a_word(small):
    felt = findings(small.cell)["contact"]
    assert (felt.status, felt.values["torque"]) == (Severity.OK, 9.0)
    small.replace("[touch]\ntorque = [9.0]\n", "")
    unfelt = findings(small.cell)["contact"]
    assert (unfelt.status, unfelt.values["torque"]) == (Severity.WARN, 80.0)
    assert "without [touch] no joint feels what links press" in unfelt.text


def test_a_frame_that_may_be_anywhere_is_worth_a_word(small):
    small.cell.write_text(small.cell.read_text() + "\n[frames.base]\nspeed = 0.1\n")
    base = findings(small.cell)["news of base"]
    assert base.status is Severity.WARN
    assert "extent" in base.text


def test_force_control_at_a_grasp_is_judged_by_what_one_arm_feels_of_another(tmp_path):
    text = (HERE / "cells/pa10_pair.toml").read_text()
    path = tmp_path / "stiff.toml"
    path.write_text(text.replace("internal_stiffness = 50000.0", "internal_stiffness = 500000.0"))
    found = {finding.check: finding for finding in judge(load_cell(path))}
    assert found["beam.left.force gain x"].status is Severity.ERROR
    assert found["beam.left.force gain x"].values["loop_gain"] == pytest.approx(1.5)
    # What touches an arm alone is as stiff as it was.
    assert found["left.force gain x"].status is Severity.OK
    shipped_one = {finding.check: finding for finding in judge(load_cell("pa10_pair"))}
    assert shipped_one["beam.right.force gain rz"].status is Severity.OK
    assert shipped_one["beam.grasps"].values["misfit_m"] < 1e-5


def test_the_force_that_a_fault_leaves_is_judged_at_rest_and_by_the_speeds_that_it_allows(tmp_path):
    text = (HERE / "cells/pa10_pair.toml").read_text()

    def fault(bound):
        path = tmp_path / "pair.toml"
        key = "most_internal_at_fault = "
        path.write_text(text.replace(f"{key}60.0", f"{key}{bound}"))
        return {finding.check: finding for finding in judge(load_cell(path))}["beam.fault"]

    shipped = fault(60.0)
    assert shipped.status is Severity.OK
    assert 0.05 < shipped.values["slowest_m_s"] < 0.15
    assert shipped.values["along"][1] == "y", "the payload is stiff along itself"
    assert fault(200.0).values["slowest_m_s"] > 2.0 * shipped.values["slowest_m_s"]
    loose = fault(15.0)
    assert loose.status is Severity.ERROR, "an arm whose brakes fall in presses more even at rest"
    assert loose.values["standing_n"] == shipped.values["standing_n"] > 15.0


def test_check_tells_when_a_wheels_counts_wrap_and_when_they_are_too_many(rover_counts):
    fine, many = rover_counts(1e5), rover_counts(4e8)
    assert fine.status is Severity.OK
    assert fine.values["wrap_m"] == pytest.approx(0.12 * 2**32 / 1e5)
    assert many.status is Severity.ERROR


@pytest.fixture
def rover_counts():
    """Return the finding about the left wheel's counts, at so many per radian."""
    rover = load_cell("rover")

    def found(counts):
        mechanism = rover.config.mechanism
        told = tuple(d.model_copy(update={"counts_per_radian": counts}) for d in mechanism.drives)
        cell = altered(rover, {"mechanism.drives": told})
        return next(f for f in drives(cell) if f.check == "wheel_left counts")

    return found
