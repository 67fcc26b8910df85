"""The benchmarks' plumbing: what they print and write; no figure is asserted."""

import json
import math
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
from laboratory.bench import cli, growth, load, rover
from laboratory.bench.growth_plot import drawn
from laboratory.bench.page import page
from telerobot.config.load import altered, load_cell
from telerobot.tools.bench import sync, tick
from telerobot.tools.bench.bare import periods
from telerobot.tools.bench.cli import table
from telerobot.tools.bench.figures import machine, percentiles
from telerobot.tools.bench.latency import without_self_motion
from telerobot.tools.cli import main
from telerobot.tools.client.operator import OperatorError


def test_tick_measures_a_free_and_a_limited_phase():
    figures = tick.bench(load_cell("ur5e"), ticks=400)
    for phase in ("free_us", "limited_us", "back_to_back_us", "arithmetic_us"):
        assert 0.0 < figures[phase]["p50"] <= figures[phase]["p99"] <= figures[phase]["max"]
    assert 0.0 < figures["limited_share"] <= 1.0


def test_bench_writes_its_figures_and_the_machine_as_json(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(tick, "TICKS", 200)
    file = tmp_path / "bench.json"
    assert main(["bench", "--only", "tick", "--quick", "--json", str(file)]) == 0
    written = json.loads(file.read_text())
    assert written["quick"] is True
    assert written["tick"].keys() == {"pa10", "ur5e", "pa10_hand_torque", "snake", "rover"}
    assert {"free_us", "limited_us", "p99_us", "target_us", "met"} <= written["tick"]["pa10"].keys()
    assert {"cores", "python", "packages"} <= written["machine"].keys()
    assert "tick pa10" in capsys.readouterr().out


@pytest.mark.parametrize("count", [1, 16])
def test_the_load_is_so_many_obstacles_and_every_barrier(count):
    cell = load.among(load_cell("pa10"), count)
    shapes = [obstacle.shape for obstacle in cell.config.obstacles]
    assert len(shapes) == count
    assert cell.config.keeps_clear
    assert cell.config.avoidance.enabled
    if count == load.OBSTACLES:
        assert set(shapes) == {"point", "sphere", "capsule", "box", "sight_line"}


def test_a_cell_at_another_period_is_the_same_but_for_that(tmp_path):
    own = load_cell("planar3")
    quick = load.at_period(own, 1e-3, tmp_path)
    assert quick.config == altered(own, {"timing.period_s": 1e-3}).config


def _swaying(mode):
    """Return a plant whose operator finds the arm in a mode, and overruns once a look."""
    looks = count()
    operator = SimpleNamespace(
        joystick=lambda *_told, **_more: None,
        wait_state=lambda: SimpleNamespace(mode=mode, overruns=next(looks)),
    )
    bus = SimpleNamespace(recv=lambda _seconds: None)
    local = SimpleNamespace(daemon=None, rig=None)
    return sync.EnabledPlant(load_cell("planar3"), operator, bus, local)


def test_what_moving_costs_is_told_of_an_arm_that_is_enabled_in_the_end_alone():
    assert sync.moving(_swaying("enabled"), 0.1) == ([], {"overruns": 1})
    with pytest.raises(OperatorError, match="did not stay enabled: hold"):
        sync.moving(_swaying("hold"), 0.1)


@pytest.mark.parametrize("joints", [6, 12, 60])
def test_a_made_chain_has_so_many_joints_and_moves(joints, tmp_path):
    cell = load.among(load.chain(load_cell("pa10"), joints, tmp_path), 2)
    assert len(cell.robot.joints) == joints
    figures = tick.bench(cell, ticks=100)
    assert figures["free_us"]["p50"] > 0.0


@pytest.mark.parametrize("count", [1, 3])
def test_arms_in_a_row_are_like_the_cells_own_with_a_task_each(count, tmp_path):
    own = load_cell("pa10")
    cell = load.among(load.several(own, count, tmp_path), load.OBSTACLES)
    assert len(cell.parts) == count
    for part in cell.parts:
        assert [j.upper for j in part.robot.joints] == [j.upper for j in own.robot.joints]
        assert len(part.config.obstacles) == load.OBSTACLES
    assert tick.bench(cell, ticks=20)["free_us"]["p50"] > 0.0


def test_one_arm_takes_the_time_of_one(monkeypatch):
    monkeypatch.setattr(growth, "ARMS", (1, 2))
    figures = growth.arms(load_cell("pa10"), ticks=20, rounds=1)
    for phase in ("free_us", "limited_us", "back_to_back_us"):
        assert figures[f"{phase}_1"]["times_one"] == 1.0
        assert figures[f"{phase}_2"]["p50"] > 0.0
        assert figures[f"{phase}_payload"]["p50"] > 0.0
    assert figures["pause_ms"] == 1e3 * tick.PAUSE_S


def test_arms_on_one_payload_are_measured_while_they_hold_it(monkeypatch):
    held = []

    class Watched(tick.Control):
        def tick(self, memory, inputs):
            after, outputs = super().tick(memory, inputs)
            held.append([output.holding is not None for output in outputs])
            return after, outputs

    monkeypatch.setattr(tick, "Control", Watched)
    tick.bench(load.among(load.on_one_payload(), load.OBSTACLES), ticks=20)
    assert held
    assert all(all(each) for each in held)


def test_growth_writes_a_row_for_each_count(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(growth, "COUNTS", (1, 3))
    monkeypatch.setattr(growth, "JOINTS", (6,))
    monkeypatch.setattr(growth, "QUICK_TICKS", 60)
    file = tmp_path / "growth.json"
    assert cli.main(["--growth", str(file), "--quick"]) == 0
    written = json.loads(file.read_text())
    assert written["obstacles"].keys() == {"1", "3"}
    assert written["joints"]["6"]["arithmetic_us"] > 0.0
    assert "3 obstacles" in capsys.readouterr().out


def test_growth_is_drawn_with_lines_for_each_percentile_and_panel():
    row = {
        "free_us": {"p50": 100.0, "p99": 150.0},
        "limited_us": {"p50": 120.0, "p99": 200.0},
        "back_to_back_us": {"p50": 60.0, "p99": 90.0},
    }
    panels = drawn({"obstacles": {1: row, 64: row}, "joints": {6: row}}).axes
    assert [panel.get_title() for panel in panels] == [
        "one tick [µs] against obstacles",
        "one tick [µs] against joints",
    ]
    for panel in panels:
        lines = {line.get_label(): line.get_ydata()[0] for line in panel.lines}
        expected = {
            "p50": 120.0,
            "p50, back to back": 60.0,
            "p99": 200.0,
            "p99, back to back": 90.0,
        }
        assert expected.items() <= lines.items()
        assert panel.get_ylim()[0] == 0.0


def test_a_rovers_ticks_are_among_sixteen_boxes_and_its_scans_end_in_contours():
    figures = rover.looking(load_cell("rover_bridge"), 1.6)
    assert figures["boxes"] >= rover.BOXES
    for name in ("tick_us", "scan_us"):
        assert 0.0 < figures[name]["p50"] <= figures[name]["p99"] <= figures[name]["max"]


def test_a_benchs_own_scanner_is_on_another_port_and_else_the_same(tmp_path):
    cell = load_cell("rover_bridge")
    own = rover.with_own_scanner(cell, tmp_path)
    assert own.config.scanner.address != cell.config.scanner.address
    back = altered(own, {"scanner.address": cell.config.scanner.address})
    assert back.config == cell.config


def test_an_unknown_benchmark_is_bad_usage():
    with pytest.raises(SystemExit) as ended:
        main(["bench", "--only", "nonsense"])
    assert ended.value.code == 2


def test_every_benchmark_names_shipped_cells():
    for _, cells in cli.BENCHES.values():
        for cell in cells:
            load_cell(cell)


def test_a_table_has_a_line_for_each_figure():
    lines = list(table("tick pa10", {"times": {"p50": 1.0, "p99": 2.0}, "met": True}))
    assert lines == [
        "tick pa10      times              p50 1.0  p99 2.0",
        "               met                yes",
    ]


def test_percentiles_of_nothing_are_not_numbers():
    assert percentiles(np.arange(101.0)) == {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}
    assert all(math.isnan(value) for value in percentiles(np.array([])).values())


def test_the_bare_loop_yields_an_error_for_each_period():
    errors = periods(0.001, 0.02)
    assert len(errors) == 19
    assert min(errors) >= 0.0


def test_the_machine_is_described():
    facts = machine()
    assert facts["cores"] >= 1
    assert facts["packages"]["numpy"] == np.__version__


@pytest.mark.parametrize("name", ["pa10", "ur5e"])
def test_a_cell_can_be_kept_from_self_motion(name, tmp_path):
    cell = without_self_motion(load_cell(name), tmp_path)
    assert cell.config.redundancy.mid_range == 0.0
    assert cell.config.mechanism == load_cell(name).config.mechanism


def test_the_fit_is_measured_beside_a_dense_solve(tmp_path):
    file = tmp_path / "bench.json"
    assert cli.main(["--only", "fit", "--quick", "--json", str(file)]) == 0
    figures = json.loads(file.read_text())["fit"]["snake"]
    assert {"10 joints", "1000 joints", "growth_100_to_1000", "paper_figures_ms"} <= figures.keys()
    assert {"fit_us", "with_curve_us", "dense_us"} == figures["100 joints"].keys()
    assert "dense_us" not in figures["1000 joints"]


def test_the_page_is_left_out_with_the_reason_where_no_browser_is(monkeypatch):
    monkeypatch.setattr("shutil.which", lambda _name: None)
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: object())
    figures = page.bench(load_cell("pa10"), True)
    assert figures == {"skipped": "no chromium here: apt-get install chromium"}
