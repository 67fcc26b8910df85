"""What a script says it is to reach is judged, printed, and told by the exit status."""

import json

import pytest
from telerobot.config.load import ConfigError, load_cell
from telerobot.tools.cli import main
from telerobot.tools.scripts.script import Expectations, load_script
from telerobot.tools.simulation.simulation import simulate

SUMMARY = {
    "mode": "enabled",
    "events": [{"name": "touched"}],
    "refused": [],
    "tool_error_m": 0.002,
    "peg_depth_m": [0.03, 0.01],
    "internal_force_n": {"max": 40.0, "last_mean": 3.0},
    "view_error_m": None,
}


def missed(summary=None, **expect):
    found = Expectations.model_validate(expect).judge({**SUMMARY, **(summary or {})})
    return [row.figure for row in found if not row.met]


@pytest.mark.parametrize(
    ("expect", "summary", "figures"),
    [
        ({}, {}, []),
        ({}, {"mode": "fault"}, ["mode"]),
        ({"mode": "fault"}, {"mode": "fault"}, []),
        ({"mode": "fault"}, {"mode": "enabled"}, ["mode"]),
        ({"mode": "hold"}, {"mode": "stopping"}, ["mode"]),
        ({"events": ["touched"]}, {}, []),
        ({"events": ["touched", "gave_way"]}, {}, ["event"]),
        ({}, {"refused": ["0.1 s: no"]}, ["refused"]),
        ({"refused": {"most": 1}}, {"refused": ["0.1 s: no"]}, []),
        ({"tool_error_m": {"most": 0.002}}, {}, []),
        ({"tool_error_m": {"most": 0.0019}}, {}, ["tool_error_m"]),
        ({"tool_error_m": {"least": 0.0021}}, {}, ["tool_error_m"]),
        ({"peg_depth_m": {"least": 0.01}}, {}, []),
        ({"peg_depth_m": {"least": 0.02}}, {}, ["peg_depth_m"]),
        ({"peg_depth_m": {"least": 0.0}}, {"peg_depth_m": []}, ["peg_depth_m"]),
        ({"internal_force_n": {"most": 39.0}}, {}, ["internal_force_n"]),
        ({"view_error_m": {"most": 1.0}}, {}, ["view_error_m"]),
        ({"view_error_px": {"most": 0.5}}, {"view_error_px": 0.5}, []),
        ({"view_error_px": {"most": 0.5}}, {"view_error_px": 0.6}, ["view_error_px"]),
        ({"wall_force_n": {"most": 1.0}}, {}, ["wall_force_n"]),
        ({"tool_error_m": {"most": 1.0}}, {"tool_error_m": float("nan")}, ["tool_error_m"]),
    ],
)
def test_each_expectation_is_met_within_its_bounds_alone(expect, summary, figures):
    assert missed(summary, **expect) == figures


BLOCKED = """
duration_s = 3.0
[[step]]
at_s = 0.2
"cmd/position" = { xyz = [0.0, 0.05, 0.0], rpy = [0.0, 0.0, 0.0], relative_to = "mrf" }
[[step]]
at_s = 1.0
"rig/fault" = { kind = "fault", target = "s2" }
"""


@pytest.mark.parametrize(
    ("expect", "code"),
    [("", 1), ('[expect]\nmode = "fault"\n', 0), ('[expect]\nmode = "enabled"\n', 1)],
)
def test_a_fault_at_the_end_is_no_success_unless_the_script_says_so(expect, code, tmp_path, capsys):
    script = tmp_path / "script.toml"
    script.write_text(BLOCKED + expect)
    assert main(["simulate", "pa10", str(script), "--json"]) == code
    told = json.loads(capsys.readouterr().out)
    assert told["mode"] == "fault"
    assert told["ok"] is (code == 0)


FREE = """
duration_s = 2.5
[[step]]
at_s = 0.2
"cmd/position" = { xyz = [0.0, 0.05, 0.0], rpy = [0.0, 0.0, 0.0], relative_to = "mrf" }
[expect]
mode = "enabled"
contact_peak_n = { most = 0.0 }
tool_error_m = { most = MOST }
"""


@pytest.mark.parametrize(("most", "code", "word"), [("0.001", 0, "met"), ("1e-9", 1, "MISSED")])
def test_a_missed_target_is_printed_and_fails_the_command(most, code, word, tmp_path, capsys):
    script = tmp_path / "script.toml"
    script.write_text(FREE.replace("MOST", most))
    assert main(["simulate", "pa10", str(script)]) == code
    (line,) = [x for x in capsys.readouterr().out.splitlines() if "tool_error_m:" in x]
    assert line.split()[0] == word
    assert f"at most {float(most):g}" in line


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("tool_eror_m = { most = 1.0 }", "tool_eror_m"),
        ("tool_error_m = {}", "least or most is expected"),
        ("tool_error_m = { least = 2.0, most = 1.0 }", "least 2 is above most 1"),
        ("mode = 'asleep'", "asleep"),
    ],
)
def test_an_expectation_that_makes_no_sense_is_refused_by_name(table, words, tmp_path):
    script = tmp_path / "script.toml"
    script.write_text(f"duration_s = 1.0\n[expect]\n{table}\n")
    with pytest.raises(ConfigError, match="expect") as refused:
        load_script(script)
    assert words in str(refused.value)


def test_a_recording_of_the_script_that_is_missed_is_still_written(tmp_path):
    script = tmp_path / "script.toml"
    script.write_text(FREE.replace("MOST", "1e-9"))
    result = simulate(load_cell("pa10"), load_script(script), tmp_path / "run.mcap")
    assert not result.ok
    assert [row.figure for row in result.expected if not row.met] == ["tool_error_m"]
