"""`telerobot plot` draws recorded runs."""

import numpy as np
import pytest
from telerobot.config.errors import ConfigError
from telerobot.tools.cli import COMMANDS, main
from telerobot.tools.recording.plot.figure import PANELS, load_recording
from telerobot.tools.recording.run_file import RecordError, read_about
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

PNG = b"\x89PNG"
STICK = {"twist": [0.0, 0.05, 0.0, 0.0, 0.0, 0.0], "expressed_in": "base"}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A second and a half of pa10 under a stick, recorded, and its result."""
    from telerobot.config.load import load_cell

    path = tmp_path_factory.mktemp("plot") / "run.mcap"
    script = Script.model_validate(
        {"description": "a push", "duration_s": 1.0, "step": [{"at_s": 0.1, "cmd/joystick": STICK}]}
    )
    simulation = Simulation(load_cell("pa10"), script, path)
    return path, simulation.run()


def test_a_recording_says_what_was_run(recorded):
    path, _ = recorded
    about = read_about(path)
    assert about["cell"].endswith("pa10.toml")
    assert about["script"] == "a push"


def test_what_is_drawn_is_what_was_simulated(recorded):
    path, result = recorded
    run = load_recording(path)
    assert run.cell.joints == ("s1", "s2", "s3", "e1", "e2", "w1", "w2")
    np.testing.assert_allclose(
        run.of_truths(lambda t: t["q"]), [truth.q for truth in result.truths], atol=1e-12
    )
    np.testing.assert_allclose(run.time, [state.time_s for state in result.states])
    from matplotlib.figure import Figure

    ax = Figure().add_subplot()
    assert PANELS["rates"](run, ax)
    drawn = np.array([line.get_ydata() for line in ax.lines])
    np.testing.assert_allclose(drawn.T, [state.dq_command for state in result.states])


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_a_run_is_drawn_as_a_picture(recorded, suffix, tmp_path, capsys):
    out = tmp_path / f"run{suffix}"
    panels = "distances,rates,stills"
    arguments = ["plot", str(recorded[0]), "--out", str(out), "--panels", panels, "--stills", "2"]
    assert main(arguments) == 0
    assert capsys.readouterr().out.strip() == str(out)
    start = out.read_bytes()[:400]
    assert start.startswith(PNG) if suffix == ".png" else b"<svg" in start or b"<?xml" in start


def test_two_runs_are_drawn_side_by_side(recorded, tmp_path):
    out = tmp_path / "both.png"
    assert main(["plot", str(recorded[0]), str(recorded[0]), "--out", str(out)]) == 0
    assert out.read_bytes().startswith(PNG)


def test_the_priority_of_avoiding_is_drawn_as_the_run_had_it(tmp_path):
    from matplotlib.figure import Figure
    from telerobot.config.load import load_cell

    path = tmp_path / "pole.mcap"
    script = Script.model_validate({"duration_s": 0.3, "step": []})
    result = Simulation(load_cell("pa10_hand_pole"), script, path).run()
    ax = Figure().add_subplot()
    assert PANELS["priority"](load_recording(path), ax)
    alpha, *spheres = ax.lines
    np.testing.assert_array_equal(alpha.get_ydata(), [s.priority for s in result.states])
    names = {line.get_label(): line.get_ydata()[-1] for line in spheres}
    told = result.states[-1].spheres
    assert names == {f"{name}: distance [m]": told[name] for name in told}


def test_the_arm_angle_is_drawn_of_every_arm_that_has_one(tmp_path):
    from matplotlib.figure import Figure
    from telerobot.config.load import load_cell

    path = tmp_path / "two.mcap"
    script = Script.model_validate({"duration_s": 0.1, "step": []})
    result = Simulation(load_cell("pa10_two"), script, path).run()
    ax = Figure().add_subplot()
    assert PANELS["arm_angle"](load_recording(path), ax)
    (other,) = result.states[0].tasks
    each = [result.states, [state.tasks[other] for state in result.states]]
    for line, states in zip(ax.lines, each, strict=True):
        drawn = [s.arm_angle for s in states]
        np.testing.assert_allclose(np.radians(line.get_ydata()), drawn, rtol=1e-12)


def test_the_error_in_the_picture_is_drawn_as_it_was_told(tmp_path):
    from matplotlib.figure import Figure
    from telerobot.config.load import load_cell
    from telerobot.tools.soak.cli import ComputedSights

    path = tmp_path / "view.mcap"
    steps = [
        {"at_s": 0.1, "cmd/posture": {"posture": "ready"}},
        {"at_s": 2.2, "operator/store_view": {"camera": "wrist"}},
    ]
    script = Script.model_validate({"duration_s": 2.5, "step": steps})
    cell = load_cell("pa10_vision")
    simulation = Simulation(cell, script, path, cameras=lambda s: ComputedSights(s, seed=0))
    told = [state.view_error_px for state in simulation.run().states]
    ax = Figure().add_subplot()
    assert PANELS["view"](load_recording(path), ax)
    wanted = [np.nan if each is None else each for each in told]
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), wanted)
    assert np.isfinite(wanted[-20:]).all()


def test_panels_without_anything_to_show_are_left_out(recorded):
    from matplotlib.figure import Figure

    run = load_recording(recorded[0])
    assert not PANELS["priority"](run, Figure().add_subplot())
    assert not PANELS["potentials"](run, Figure().add_subplot())
    assert not PANELS["off_path"](run, Figure().add_subplot())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--panels", "rates,nonsense"], "--panels: value 'nonsense': one of distances"),
        (["--out", "run.pdf"], "--out: value 'run.pdf': must end in .png or .svg"),
        (["--cell", "ur5e"], "its arm has 7 joints"),
    ],
)
def test_bad_arguments_end_in_one_line(recorded, arguments, words, capsys):
    assert main(["plot", str(recorded[0]), *arguments]) == 2
    complaint = capsys.readouterr().err
    assert words in complaint
    assert complaint.count("\n") == 1


def test_a_file_that_is_no_recording_is_refused_by_name(tmp_path, capsys):
    path = tmp_path / "run.mcap"
    path.write_bytes(b"not a recording at all, but long enough to look like something")
    with pytest.raises(RecordError, match="not an MCAP recording"):
        load_recording(path)
    assert main(["plot", str(path)]) == 2
    assert str(path) in capsys.readouterr().err


def test_a_camera_that_there_is_not_is_refused_by_name(recorded):
    with pytest.raises(ConfigError, match="no camera 'attic'"):
        load_recording(recorded[0]).camera("attic")


def test_a_run_of_two_arms_is_drawn_with_both(tmp_path):
    from matplotlib.figure import Figure
    from telerobot.config.load import load_cell

    path, out = tmp_path / "two.mcap", tmp_path / "two.png"
    stick = {"task": "right", **STICK}
    script = Script.model_validate(
        {"duration_s": 0.8, "step": [{"at_s": 0.1, "cmd/joystick": stick}]}
    )
    result = Simulation(load_cell("pa10_two"), script, path).run()
    run, ax = load_recording(path), Figure().add_subplot()
    assert (run.cell.joints[0], run.cell.joints[7]) == ("left.s1", "right.s1")
    assert {name: p.shape for name, p in run.tool_paths.items()} == {
        "left": (len(result.truths), 3), "right": (len(result.truths), 3),
    }  # fmt: skip
    assert np.ptp(run.tool_paths["right"], axis=0).max() > 0.02
    assert PANELS["distances"](run, ax)
    between = [truth.between_arms_m for truth in result.truths]
    np.testing.assert_allclose(ax.lines[0].get_ydata(), between)
    assert main(["plot", str(path), "--out", str(out), "--stills", "2"]) == 0
    assert out.read_bytes().startswith(PNG)


def test_a_run_with_a_payload_shows_it_and_what_presses_it(tmp_path):
    from matplotlib.figure import Figure
    from telerobot.config.load import load_cell

    path, out = tmp_path / "pair.mcap", tmp_path / "pair.png"
    script = Script.model_validate(
        {"duration_s": 0.6, "step": [{"at_s": 0.1, "cmd/joystick": {"task": "beam", **STICK}}]}
    )
    result = Simulation(load_cell("pa10_pair"), script, path).run()
    run, ax = load_recording(path), Figure().add_subplot()
    assert PANELS["internal_force"](run, ax)
    internal = [truth.beam.internal_force for truth in result.truths]
    np.testing.assert_allclose(ax.lines[0].get_ydata(), internal)
    assert main(["plot", str(path), str(path), "--out", str(out)]) == 0
    assert out.read_bytes().startswith(PNG)


def test_the_panels_that_are_drawn_unless_others_are_asked_for_are_all():
    plot = next(command for command in COMMANDS if command.name == "plot")
    assert plot.arguments["--panels"]["default"].split(",") == [*PANELS, "stills"]
