"""The four cases beside the pole, on drives that follow at once (Hamaguchi, Taniguchi, 5)."""

import itertools
import math

import numpy as np
from laboratory.papers.hamaguchi import CASES
from telerobot.config.load import altered, load_cell
from telerobot.server.control.arm import Arm as ArmControl
from telerobot.server.control.inputs import Settings
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.parameters import Parameters
from telerobot.server.control.spatial import Pose
from telerobot.server.control.tick import Control
from telerobot.server.events import Events
from telerobot.server.perception.obstacle_map import ObstacleMap

from ...conftest import shared
from ..conftest import SOURCES, Arm, Run


@shared
def led_past_the_pole(case):
    """Return the run of one case: (0, 4, 0)·sin²(πt/6) N for 6 s, run for 7 s."""
    cell = altered(load_cell("pa10_hand_pole"), CASES[case], "priority")
    p, mechanism = Parameters.from_cell(cell), Mechanism.from_cell(cell)
    m, sources = cell.config.mechanism, cell.config.sources
    gains = {s: np.array(getattr(sources, s).gain) for s in (*SOURCES, "following")}
    settings = Settings(
        gains={**gains, "force": np.zeros(6)},
        T_wrist_mrf=Pose.from_xyz_rpy(m.T_wrist_mrf.xyz, m.T_wrist_mrf.rpy),
        T_world_crf=Pose.identity(),
        wrench_bias=np.zeros(6),
    )
    arm = Arm(cell, p, mechanism, Control([ArmControl(p, mechanism)]), settings)
    scene, run = ObstacleMap.from_cell(cell, Events()).scene(0), Run(arm, arm.posture("start"))
    for i in range(round(7.0 / p.period_s)):
        t = i * p.period_s
        hand = np.array([0.0, 4.0, 0.0]) * math.sin(math.pi * t / 6.0) ** 2 * (t < 6.0)
        wrench = arm.control.arms[0].weight(run.pose, settings)
        wrench[:3] -= run.pose.R.T @ hand
        run.tick(scene=scene, wrench_sensor=wrench)
    run.observe()
    return run


def least_of(case):
    """Return the least distance of both spheres in one case [m]."""
    return min(o.near.distances.least for o in led_past_the_pole(case).outputs)


def test_each_case_keeps_further_away_and_only_priority_keeps_the_inner_spheres_free():
    least = [least_of(case) for case in CASES]
    assert all(b - a > 0.01 for a, b in itertools.pairwise(least)), least
    assert max(least[:3]) < 0.15 < least[3], least


def test_rates_of_avoiding_do_not_move_the_tool_and_priority_does():
    free, led, kept = (led_past_the_pole(case) for case in (0, 2, 3))
    assert np.abs(led.outputs[-1].q - free.outputs[-1].q).max() > 0.3
    assert np.abs(led.pose.p - free.pose.p).max() < 0.01
    assert kept.pose.p[1] < free.pose.p[1] - 0.05


def test_what_is_near_is_told():
    outputs = led_past_the_pole(3).outputs
    alphas = np.array([o.near.alpha for o in outputs])
    assert alphas[0] < 0.01 < 0.3 < alphas.max()
    assert np.diff(alphas).max() < 0.02
    assert max(o.found.self_motion.norms["spheres"] for o in outputs) > 0.05
    none = [o.found.self_motion.norms for o in led_past_the_pole(0).outputs]
    assert not any(norms["spheres"] for norms in none)
