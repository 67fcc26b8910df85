"""An arm that follows a curve keeps off the walls along every stop, wherever it is stopped."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.inputs import (
    STILL,
    DriveRequest,
    Inputs,
    Intent,
    PathGoal,
    Settings,
    StickCommand,
    ViewGoal,
)
from telerobot.server.control.spatial import Pose, pose_error
from telerobot.server.control.stop.trajectory import Stop
from telerobot.server.control.tick import Control

SETTINGS = Settings(
    gains={},
    T_wrist_mrf=Pose.identity(),
    T_world_crf=Pose.identity(),
    wrench_bias=np.zeros(6),
)


@dataclass
class Snake:
    """A snake on drives that follow at once."""

    name: str
    s1: float | None = None

    def __post_init__(self):
        self.control = Control.of(load_cell(self.name))
        self.backbone = self.control.arms[0].body.backbone
        lengths = self.backbone.lengths
        near = self.backbone.section.start if self.s1 is None else self.s1
        q = self.backbone.fits[int(np.abs(lengths - near).argmin())]
        self.memory = self.control.seed(q)
        self.q, self.tick = q, 0

    def step(self, intent=Intent.MOVE, drive=STILL, behind=None, **more):
        measured = self.q if behind is None else self.q - behind
        given = Inputs(
            time_s=0.01 * self.tick,
            intent=intent,
            q_measured=measured,
            settings=more.pop("settings", SETTINGS),
            drive=drive,
            **more,
        )
        self.memory, (output,) = self.control.tick(self.memory, (given,))
        self.q, self.tick = output.q, self.tick + 1
        assert output.refusal is None
        return output

    def off(self):
        s1 = 1.5 if self.memory.arms[0].insertion is None else self.memory.arms[0].insertion.s1
        return self.backbone.off_centre(self.backbone.chain.points(self.q[None]), s1)


@pytest.mark.parametrize("name", ["snake", "snake_space", "snake_helix", "snake_gap"])
def test_it_keeps_its_room_however_it_is_driven_and_stopped(name):
    snake, draw = Snake(name, 1.0), np.random.default_rng(7)
    for _ in range(14):
        drive = DriveRequest(float(draw.uniform(-0.08, 0.08)))
        for _ in range(int(draw.integers(10, 60))):
            snake.step(drive=drive)
            assert snake.off() < snake.backbone.room
        stopped = 0
        while not snake.step(Intent.STOP).at_rest:
            assert snake.off() < snake.backbone.room
            stopped += 1
            assert stopped < 100
        for _ in range(3):
            assert not snake.step(Intent.HOLD).dq.any()


def test_with_another_exterior_it_slithers_as_well(tmp_path):
    path = tmp_path / "modal.toml"
    path.write_text('extends = "snake"\n[mechanism.backbone]\nexterior = "modal"\n')
    snake = Snake(path, 0.95)
    # The curvature begins with 0 where that of the paper's begins with its greatest.
    assert abs(snake.q[0]) < 0.4 * abs(Snake("snake", 0.95).q[0])
    for _ in range(300):
        snake.step(drive=DriveRequest(0.08))
        assert snake.off() < snake.backbone.room
    assert snake.memory.arms[0].insertion.s1 < 0.75
    while not snake.step(Intent.STOP).at_rest:
        assert snake.off() < snake.backbone.room


def test_its_joints_stop_in_proportion():
    snake = Snake("snake", 1.0)
    for _ in range(60):
        before = snake.step(drive=DriveRequest(0.08)).dq
    shares = []
    while not (output := snake.step(Intent.STOP)).at_rest:
        if np.linalg.norm(output.dq) > 0.05:
            shares.append(output.dq / np.linalg.norm(output.dq))
    assert len(shares) > 5
    assert np.abs(np.array(shares) - before / np.linalg.norm(before)).max() < 0.1


def test_what_a_joint_lags_is_taken_off_the_room():
    snake = Snake("snake", 1.0)
    body = snake.control.arms[0].body
    snake.step()
    insertion, lag, aside = snake.memory.arms[0].insertion, np.zeros(30), snake.q.copy()
    aside[25] -= 0.02  # the tip is 5 mm aside
    stop = Stop.at_rest(aside)
    points = snake.backbone.chain.points(aside[None])
    assert snake.off() + 0.001 < snake.backbone.off_centre(points, insertion.s1)
    assert body.violation(insertion, snake.q, lag, stop) == 0.0
    lag[20] = 0.02  # half a metre of arm beyond it: 10 mm
    assert body.violation(insertion, snake.q, lag, stop) > 0.0005


def test_at_the_ends_of_its_way_it_slows_down_and_says_so():
    snake = Snake("snake", 0.66)
    told = [snake.step(drive=DriveRequest(0.08)).limits for _ in range(200)]
    assert snake.memory.arms[0].insertion.s1 == pytest.approx(0.63, abs=2e-3)
    assert "insertion_speed" in told[100]


def test_a_posture_that_is_not_the_curve_s_does_not_move():
    snake = Snake("snake")
    snake.memory = snake.control.seed(np.zeros(30))
    snake.q = np.zeros(30)
    output = snake.step(drive=DriveRequest(0.05))
    assert output.limits == ("off_backbone",)
    assert not output.dq.any()


def test_where_it_is_is_found_again_at_any_depth():
    snake, draw = Snake("snake_tail"), np.random.default_rng(2)
    backbone = snake.backbone
    for s1 in draw.uniform(backbone.section.least, backbone.most, 12):
        i = int(np.abs(backbone.lengths - s1).argmin())
        q = backbone.chain.settled(
            backbone.fits[i], *backbone.curve.at(s1, backbone.chain.stations)
        ).q
        tail = backbone.beyond(s1)
        q[tail:] += draw.normal(0.0, 0.3, 30 - tail)  # free joints may be anywhere
        assert backbone.located(q).s1 == pytest.approx(s1, abs=1e-5)


def test_a_tail_in_space_answers_all_sources_at_once_while_the_rest_stands():
    snake = Snake("snake_tail_space", 0.48)
    here = snake.step().T_world_mrf
    before, gain = snake.q, np.full(6, 0.5)
    gains = {"joystick": np.ones(6), "position": gain, "vision": gain, "force": 1e-3 * np.ones(6)}
    seen = Pose(here.R, here.p + np.array([0.02, 0.01, -0.02]))
    given = {
        "settings": replace(SETTINGS, gains=gains),
        "stick": StickCommand(np.array([0.004, -0.006, 0.008, 0.02, -0.03, 0.02]), np.eye(3)),
        "goal": PathGoal(Pose(here.R, here.p + np.array([-0.01, 0.01, 0.01])), 1),
        "view": ViewGoal(Pose.identity(), seen),
        "wrench_sensor": np.array([2.0, -3.0, 2.0, 0.01, 0.02, -0.01]),
    }
    outputs = [snake.step(**given) for _ in range(80)]
    sources = outputs[-1].twists
    assert min(float(np.linalg.norm(sources[name])) for name in gains) > 1e-3
    assert sum(sources.values()) == pytest.approx(outputs[-1].twist, abs=1e-15)
    # The head does on all six axes what they ask for together.
    asked = np.mean([output.twist for output in outputs[40:-1]], axis=0)
    moved = pose_error(outputs[-1].T_world_mrf, outputs[40].T_world_mrf) / 0.39
    assert np.abs(asked).min() > 1e-3
    assert moved == pytest.approx(asked, abs=5e-4)
    assert snake.memory.arms[0].insertion.beyond == 21
    assert np.abs(snake.q - before)[:21].max() < 1e-4
    assert np.abs(snake.q - before)[21:].max() > 0.02
