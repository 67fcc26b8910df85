"""Views that are kept by their picture, on rendered pictures; judged by the physics' truth."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.section import PoseSection
from telerobot.server.control.spatial import Pose, rotation_exp
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.judges import ViewJudge
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

pytestmark = pytest.mark.usefixtures("rendering")

REACHED = (2.5e-3, np.radians(0.5), 0.15)
"""Greatest distance and angle of the true Lens, and of corners in the picture [m], [rad], [px]."""

STORE = [
    {"at_s": 0.2, "cmd/posture": {"posture": "ready"}},
    {"at_s": 2.2, "operator/store_view": {"camera": "wrist"}},
]
ASIDE = [
    {"at_s": 2.5, "cmd/position": {"xyz": [-0.22, 0.20, 0.04], "rpy": [0.0, 0.13, -0.53],
     "relative_to": "mrf", "expressed_in": "base", "speed": 0.15}},
    {"at_s": 5.5, "cmd/cancel": {}},
    {"at_s": 5.8, "operator/switch": {"source": "vision", "on": True}},
]  # fmt: skip


@pytest.fixture(scope="module")
def cell():
    return load_cell("pa10_vision")


def by(law, cell):
    """Return a cell whose cameras keep their views by a law."""
    return altered(cell, {f"cameras.{i}.law": law for i in range(len(cell.config.cameras))})


def errors(run, from_s=0.0):
    """Return distance, angle and picture's error (k, 3) of the true view, tick by tick."""
    start, view = run.simulation.player.start_s, run.simulation.view
    return np.array(
        [
            (*view.error(t), view.error_px(t))
            for t in run.truths
            if from_s <= t.time_s - start - 1e-9 and view.error(t) is not None
        ]
    )


def clean(run):
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0
    assert [e for e in run.simulation.events if e.severity == "error"] == []


def played(cell, steps, seconds, seen_by=None):
    """Play steps in a cell; `seen_by`: what the rig's cameras truly are."""
    script = Script.model_validate({"duration_s": seconds, "step": steps})
    simulation = Simulation(cell, script, cameras=seen_by and (lambda s: _off(s, cell, seen_by)))
    if seen_by:
        simulation.view = ViewJudge(seen_by)
    return Run(simulation, simulation.run())


def _off(simulation, cell, true):
    """Return the true cell's cameras, their pictures looked at as the cell's have it."""
    from telerobot.drivers.rig.cameras import RenderedCameras
    from telerobot.drivers.vision.detector import Detector

    cameras = RenderedCameras(true, simulation.rig, simulation.link.put)
    cameras._detectors = {c.name: Detector(c) for c in cell.config.cameras}
    return cameras


@pytest.mark.parametrize("script", ["vision_servo", "vision_beside"])
def test_a_camera_on_the_wrist_and_one_beside_the_arm_lead_back_to_their_picture(cell, script):
    simulation = Simulation(by("image", cell), load_script(script))
    run = Run(simulation, simulation.run())
    clean(run)
    assert run.summary["ok"], run.summary["expected"]
    assert run.events("view_lost") == run.events("picture_rejected") == []
    assert errors(run).max(axis=0)[2] > 90.0
    assert np.all(errors(run)[-50:].max(axis=0) < REACHED)
    assert run.summary["view_error_px"] == errors(run)[-1, 2]
    # What is told of a tick is what its newest picture shows, to the noise of one.
    assert max(state.view_error_px for state in run.states[-50:]) < 0.1
    assert {state.view_law for state in run.states} == {"image"}


@pytest.mark.parametrize("law", ["pose", "image"])
def test_a_wrong_focal_length_and_a_lens_that_is_elsewhere_move_no_view_that_was_stored(cell, law):
    """5 %, 10 mm and 2°: by either law, since both compare with what the same camera stored."""
    lens = cell.config.cameras[0].T_wrist_lens
    place = Pose.from_xyz_rpy(lens.xyz, lens.rpy)
    axis = np.array([1.0, -1.0, 1.0]) / np.sqrt(3.0)
    x, y, z, *rpy = Pose(
        place.R @ rotation_exp(np.radians(2.0) * axis), place.p + 0.01 * axis
    ).to_xyz_rpy()
    there = {"focal": (441.0, 441.0), "T_wrist_lens": PoseSection(xyz=(x, y, z), rpy=tuple(rpy))}
    told = altered(by(law, cell), there, "cameras.0")
    run = played(told, STORE + ASIDE, 12.0, seen_by=cell)
    clean(run)
    assert errors(run, 5.6)[0, 0] > 0.3
    metres, radians, pixels = errors(run)[-100:].max(axis=0)
    assert pixels < 0.5
    assert metres < 4e-3
    assert radians < np.radians(0.4)


@pytest.fixture(scope="module")
def misprinted(cell):
    """A board whose second tag is 10 mm from where the cell has it."""
    rig = cell.config.rig
    (panel,) = (tag for tag in rig.tags if tag.name == "panel")
    there = panel.T_world_tag.model_copy(update={"xyz": (1.16, -0.13, 0.46)})
    beside = panel.model_copy(
        update={"name": "beside", "tag": 9, "size": 0.08, "T_world_tag": there}
    )
    board = ({"tag": 9, "size": 0.08, "T_board_tag": {"xyz": (0.14, -0.02, 0.0)}},)
    return altered(cell, {"rig.tags": (*rig.tags, beside), "cameras.0.board": board})


@pytest.mark.parametrize(("law", "reaches"), [("pose", False), ("image", True)])
def test_while_a_tag_is_covered_a_board_that_is_told_badly_misleads_a_pose_and_no_picture(
    misprinted, law, reaches
):
    away = {"xyz": [-0.12, 0.08, 0.03], "rpy": [0.0, 0.1, -0.2]}
    steps = [
        *STORE,
        {"at_s": 2.5, "cmd/position": {**ASIDE[0]["cmd/position"], **away}},
        {"at_s": 4.8, "cmd/cancel": {}},
        {"at_s": 4.9, "rig/fault": {"kind": "cover", "target": "panel"}},
        {"at_s": 5.2, "operator/switch": {"source": "vision", "on": True}},
    ]
    run = played(by(law, misprinted), steps, 13.0)
    clean(run)
    assert run.events("view_lost") == []
    assert errors(run, 5.0)[0, 0] > 0.1
    found = errors(run)[-100:]
    assert np.all(found.max(axis=0) < REACHED) == reaches
    assert reaches or found[:, 0].min() > 0.02


def test_half_a_turn_about_the_optical_axis_backs_off_by_a_seventh_and_meets_no_limit(cell):
    """The Lens on the last joint's axis, before the tool, so that the tag stays in its picture."""
    rig = cell.config.rig
    ahead = rig.tags[0].T_world_tag.model_copy(update={"xyz": (1.16, 0.0, 0.40)})
    centred = altered(
        by("image", cell),
        {"cameras.0.T_wrist_lens.xyz": (0.0, 0.0, 0.15), "rig.tags.0.T_world_tag": ahead},
    )
    turned = [*centred.config.mechanism.postures["ready"]]
    turned[6] += np.pi
    run = played(
        centred,
        [
            *STORE,
            {"at_s": 2.5, "cmd/posture": {"q": turned}},
            {"at_s": 6.5, "operator/switch": {"source": "vision", "on": True}},
        ],
        20.0,
    )
    clean(run)
    assert errors(run, 6.4)[0, 1] > np.radians(179.0)
    assert np.all(errors(run)[-50:].max(axis=0) < REACHED)
    start, view = run.simulation.player.start_s, run.simulation.view
    depths = [view.view(t).p[2] for t in run.truths if t.time_s > start + 6.5]
    assert max(depths) < 1.18 * depths[0]
    assert {name for s in run.states if s.time_s > start + 6.6 for name in s.limits} == set()
    rates = np.array([s.sources["vision"] for s in run.states])
    assert np.linalg.norm(rates[:, 3:], axis=1).max() < 0.4 * 1.01


def test_a_law_is_asked_for_while_running_and_a_script_waits_for_the_pictures_error(cell):
    wait = {"view_error_px": 0.5, "timeout_s": 12.0}
    steps = [
        *STORE,
        *ASIDE[:2],
        {"at_s": 5.6, "operator/store_view": {"camera": "wrist", "again": True, "law": "image"}},
        ASIDE[2],
        {"at_s": 6.0, "until": wait},
        {"at_s": 6.1, "operator/switch": {"source": "vision", "on": False}},
    ]
    run = played(cell, steps, 6.3)
    clean(run)
    (kept,) = run.events("view_kept")
    assert kept.values["law"] == "image"
    assert run.events("view_stored")[0].values["law"] == "pose"
    assert errors(run, 5.0)[:, 2].max() > 90.0
    assert errors(run)[-1, 2] < 1.0
    assert run.states[-1].view_law == "image"
