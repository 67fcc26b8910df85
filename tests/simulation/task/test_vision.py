"""Vision in virtual time, on rendered pictures; judged by the physics' truth."""

import re
import sys
from types import ModuleType

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.surroundings import FramesSection, MovingFrameSection
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.simulation import Simulation
from telerobot.tools.soak import cli as sights

from ...conftest import shared
from ...test_pages import ROOT
from ..conftest import Run

pytestmark = pytest.mark.usefixtures("rendering")

GUIDE = ROOT / "config/guides/camera.md"

REACHED = (2e-3, np.radians(0.5))
"""Greatest distance and angle of the true Lens from the stored view [m], [rad]."""

COARSE = (0.025, 0.05)
"""The same by OpenCV's detector of QR codes, whose corners are 1 to 2 pixels off [m], [rad]."""

STORE = [
    {"at_s": 0.2, "cmd/posture": {"posture": "ready"}},
    {"at_s": 2.2, "operator/store_view": {"camera": "wrist"}},
    {"at_s": 2.3, "operator/switch": {"source": "vision", "on": True}},
]


@pytest.fixture(scope="module")
def cell():
    return load_cell("pa10_vision")


@pytest.fixture(scope="module")
def shown(cell):
    """Play a shipped script, once for all tests of it."""

    @shared
    def play(name):
        simulation = Simulation(cell, load_script(name))
        return Run(simulation, simulation.run())

    return play


def errors(run, from_s=0.0, to_s=1e9):
    """Return distances and angles (k, 2) of the true view from the stored one, tick by tick."""
    start = run.simulation.player.start_s
    return np.array(
        [
            run.simulation.view.error(t)
            for t in run.truths
            if from_s <= t.time_s - start - 1e-9 <= to_s
        ]
    )


def clean(run):
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0
    assert [e for e in run.simulation.events if e.severity == "error"] == []


@pytest.mark.parametrize("name", ["vision_servo", "vision_cover", "vision_nudge", "vision_beside"])
def test_every_script_ends_at_the_stored_view(shown, name):
    run = shown(name)
    clean(run)
    metres, radians = errors(run)[-50:].max(axis=0)
    assert metres < REACHED[0]
    assert radians < REACHED[1]
    assert (run.summary["view_error_m"], run.summary["view_error_rad"]) == tuple(errors(run)[-1])


def test_the_servo_starts_from_as_far_off_as_it_says(shown):
    metres, radians = errors(shown("vision_servo"), 7.9, 7.95)[0]
    assert metres > 0.3
    assert radians > np.radians(30.0)


def test_on_its_way_the_tag_is_never_lost(shown):
    run = shown("vision_servo")
    assert run.events("view_lost") == run.events("picture_rejected") == []


def test_covering_the_tag_stops_the_arm_smoothly_and_uncovering_resumes(shown):
    run = shown("vision_cover")
    start = run.simulation.player.start_s
    (rejected,), (lost,) = run.events("picture_rejected"), run.events("view_lost")
    assert rejected.values["reason"] == lost.values["reason"] == "no_tag"
    assert 9.0 < rejected.time_s - start < 9.0 + 0.12
    assert 9.2 < lost.time_s - start < 9.5
    moving, standing = errors(run, 8.8, 9.0), errors(run, 10.5, 12.0)
    assert np.ptp(moving[:, 0]) > 0.02
    assert np.ptp(standing[:, 0]) < 2e-4
    # The fade keeps inside the Cartesian bounds that shape it.
    states = [s for s in run.states if 9.0 <= s.time_s - start <= 10.5]
    rates = np.array([s.sources["vision"] for s in states])
    limits = run.simulation.cell.config.limits
    assert np.abs(np.diff(rates[:, :3], axis=0)).max() <= limits.acceleration * 0.01 * 1.001
    assert np.abs(np.diff(rates[:, 3:], axis=0)).max() <= limits.angular_acceleration * 0.01 * 1.001
    assert not rates[-1].any()
    found = run.events("view_found")[-1]
    assert 12.0 < found.time_s - start < 12.15
    assert np.ptp(errors(run, 12.1, 12.8)[:, 0]) > 0.05


def test_a_stick_nudges_the_view_and_on_release_it_comes_back(shown):
    run = shown("vision_nudge")
    aside = errors(run, 6.8, 6.9)[0]
    assert aside[0] > 0.03
    held = run.at(6.9)
    for name in ("joystick", "vision"):
        assert np.abs(held.sources[name]).max() > 0.02
    # Where gain times error equals the stick: the sum of both is nothing.
    assert np.abs(np.array(held.twist[:3])).max() < 0.01


def test_the_source_moves_nothing_before_it_is_switched_on(shown):
    run = shown("vision_servo")
    before = [s for s in run.states if s.time_s - run.simulation.player.start_s < 8.0]
    assert not np.array([s.sources["vision"] for s in before]).any()
    assert before[-1].view is not None
    assert before[-1].view_age_ticks < 20


def test_conflicting_vision_and_position_settle_in_between_as_their_gains_say(cell, monkeypatch):
    """On exact sights, for pictures tell the attitude of a tag head-on to 5 mrad only.

    That is a fifteenth of a pixel in its corners, and at 0.55 m it is 2 mm of the way.
    """
    for wrong, much in (("NOISE", (0.0, 0.0)), ("LATE", 0.0), ("LEAPING", 0.0)):
        monkeypatch.setattr(sights, wrong, much)
    step = {"xyz": [-0.03, 0.05, 0.0], "rpy": [0.0, 0.0, 0.0], "relative_to": "mrf"}
    steps = [
        *STORE,
        {"at_s": 2.4, "operator/gain": {"source": "position", "gain": [1.0] * 6}},
        {"at_s": 2.4, "cmd/position": {**step, "expressed_in": "base"}},
        {"at_s": 6.0, "operator/switch": {"source": "position", "on": False}},
    ]
    script = Script.model_validate({"duration_s": 8.5, "step": steps})
    simulation = Simulation(cell, script, cameras=lambda s: sights.ComputedSights(s, seed=0))
    run = Run(simulation, simulation.run())
    clean(run)
    # K_V = 1.5 /s holds the view against K_P = 1 /s: 1 / 2.5 of the way.
    between = errors(run, 5.6, 5.9)
    np.testing.assert_allclose(between[:, 0], np.hypot(0.03, 0.05) / 2.5, atol=1e-4)
    assert between[:, 1].max() < 2e-4
    metres, radians = errors(run)[-1]
    assert metres < REACHED[0]
    assert radians < REACHED[1]


def test_a_target_that_jumps_is_refused_by_name_and_then_followed(play, cell):
    steps = [
        *STORE,
        {
            "at_s": 3.0,
            "rig/fault": {"kind": "move", "target": "panel", "vector": [1.16, 0.18, 0.48]},
        },
    ]
    run = play(*steps, seconds=14.0, cell=cell)
    clean(run)
    # On the way to the posture, before the view is stored, the tag passes the picture's rim.
    rejected = [event for event in run.events("picture_rejected") if event.time_s > 3.0]
    assert rejected[0].values["reason"] == "jump"
    assert run.events("view_lost")[0].values["reason"] == "jump"
    metres, radians = errors(run)[-1]
    assert metres < REACHED[0]
    assert radians < REACHED[1]


def test_a_stop_takes_the_switch_back_so_that_no_resume_sets_the_arm_in_motion(play, cell):
    steps = [
        *STORE,
        {"at_s": 2.5, "cmd/joystick": {"twist": [0.0, 0.08, 0.0, 0.0, 0.0, 0.0]}},
        {"at_s": 3.5, "operator/mode": {"action": "hold"}},
        {"at_s": 3.5, "silence": ["cmd/joystick"]},
        {"at_s": 4.5, "operator/mode": {"action": "resume"}},
    ]
    run = play(*steps, seconds=6.0, cell=cell)
    assert run.summary["mode"] == "enabled"
    assert errors(run)[-1][0] > 0.01
    assert not np.array([s.sources["vision"] for s in run.states[-100:]]).any()


def test_without_a_view_the_source_is_not_switched_on(play, cell):
    run = play(
        {"at_s": 0.2, "operator/switch": {"source": "vision", "on": True}}, seconds=0.5, cell=cell
    )
    (refused,) = run.summary["refused"]
    assert "not_now: no view is stored yet" in refused


def test_a_view_of_nothing_is_not_stored(play, cell):
    steps = [
        {"at_s": 0.1, "rig/fault": {"kind": "cover", "target": "panel"}},
        {"at_s": 1.0, "operator/store_view": {"camera": "wrist"}},
    ]
    run = play(*steps, seconds=1.2, cell=cell)
    (refused,) = run.summary["refused"]
    assert "sensor_stale: camera wrist sees no tag now" in refused


def test_equal_runs_send_equal_frames_pictures_and_all(play, cell):
    runs = [play(*STORE, seconds=3.5, cell=cell) for _ in range(2)]
    assert runs[0].summary["command_hash"] == runs[1].summary["command_hash"]


def test_a_view_is_kept_from_a_platform_that_sways(play, cell):
    """By the Lens's true pose; the tag stands in World, and pictures are of the true platform."""
    frames = FramesSection(base=MovingFrameSection())
    swaying = altered(cell, {"frames": frames})
    sway = {"target": "platform", "sway": [0.0, 0.04, 0.02, 0.02, 0.0, 0.03], "period_s": 4.0}
    run = play(
        *STORE,
        {"at_s": 2.5, "cmd/joystick": {"twist": [0.0, 0.06, 0.03, 0.0, 0.0, 0.1]}},
        {"at_s": 3.5, "cmd/joystick": {"twist": [0.0] * 6}},
        {"at_s": 3.5, "rig/motion": sway},
        seconds=12.0,
        cell=swaying,
    )
    clean(run)
    assert run.events("view_lost") == run.events("picture_rejected") == []
    assert errors(run, 3.4, 3.5)[-1][0] > 0.02
    start = run.simulation.player.start_s
    base = np.array([t.frames["base"] for t in run.truths if t.time_s > start + 7.0])
    assert np.ptp(base[:, 1]) > 0.07
    metres, radians = errors(run, 7.0).max(axis=0)
    assert metres < 3e-3
    assert radians < 4e-3


def test_a_view_is_reached_by_another_tag_of_the_board_while_its_own_is_covered(play, cell):
    rig = cell.config.rig
    (panel,) = (tag for tag in rig.tags if tag.name == "panel")
    beside = {"xyz": (1.16, -0.13, 0.46), "rpy": panel.T_world_tag.rpy}
    update = {"name": "beside", "tag": 9, "size": 0.08}
    update["T_world_tag"] = panel.T_world_tag.model_copy(update=beside)
    board = ({"tag": 9, "size": 0.08, "T_board_tag": {"xyz": (0.13, -0.02, 0.0)}},)
    boarded = altered(
        cell,
        {"rig.tags": (*rig.tags, panel.model_copy(update=update)), "cameras.0.board": board},
    )
    steps = [
        *STORE[:2],
        {"at_s": 2.5, "cmd/position": {"xyz": [-0.12, 0.08, 0.03], "rpy": [0.0, 0.1, -0.2],
         "relative_to": "mrf", "expressed_in": "base", "speed": 0.15}},
        {"at_s": 4.8, "cmd/cancel": {}},
        {"at_s": 4.9, "rig/fault": {"kind": "cover", "target": "panel"}},
        {"at_s": 5.2, "operator/switch": {"source": "vision", "on": True}},
    ]  # fmt: skip
    run = play(*steps, seconds=12.0, cell=boarded)
    clean(run)
    assert errors(run, 4.9, 5.1)[:, 0].min() > 0.1
    metres, radians = errors(run)[-50:].max(axis=0)
    assert metres < 2.5 * REACHED[0]
    assert radians < 2.5 * REACHED[1]
    assert run.events("view_lost") == []


def qr_code(cells, cell_px):
    """Return a QR code in place of a tag's cells, with one cell of white around it."""
    import cv2

    code = cv2.QRCodeEncoder.create().encode("telerobot")
    dark = np.flatnonzero((code == 0).any(axis=0))
    code = code[dark[0] : dark[-1] + 1, dark[0] : dark[-1] + 1]
    side = cells * cell_px
    big = cv2.resize(code, (side, side), interpolation=cv2.INTER_NEAREST)
    return np.pad(big, cell_px, constant_values=255)


def test_a_detector_that_is_not_ours_leads_the_arm_to_the_view_of_a_qr_code(
    play, cell, monkeypatch
):
    """The detector of the guide, by its hook; what hangs on the panel is a QR code."""
    from telerobot.drivers.rig.physics import camera
    from telerobot.drivers.vision.opencv import cells

    source = re.search(r"```python\n(.*?)```", GUIDE.read_text(), re.DOTALL).group(1)
    module = ModuleType("my_squares")
    exec(source, module.__dict__)
    monkeypatch.setitem(sys.modules, "my_squares", module)
    monkeypatch.setattr(camera, "marker", lambda family, _tag, px: qr_code(cells(family), px))
    changes = {"cameras.0.detector": "my_squares:QrCode", "sources.vision.enabled": False}
    run = play(
        *STORE[:2],
        {"at_s": 2.5, "cmd/position": {"xyz": [-0.08, 0.06, 0.03], "rpy": [0.0, 0.1, -0.2],
         "relative_to": "mrf", "expressed_in": "base", "speed": 0.15}},
        {"at_s": 4.3, "cmd/cancel": {}},
        {"at_s": 4.5, "operator/switch": {"source": "vision", "on": True}},
        seconds=11.0,
        cell=altered(cell, changes),
    )  # fmt: skip
    clean(run)
    assert errors(run, 4.3, 4.5)[:, 0].min() > 0.08
    metres, radians = errors(run)[-100:].max(axis=0)
    assert metres < COARSE[0]
    assert radians < COARSE[1]
    assert run.events("view_lost") == []
