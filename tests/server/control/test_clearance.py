"""Barriers and verified stops over clearances: kept under hostile sticks, and never a trap."""

import math
from dataclasses import replace

import numpy as np
import pytest
from telerobot.config.load import altered
from telerobot.config.schema.surroundings import (
    AllowedContactSection,
    AvoidanceSection,
    ObstacleSection,
    ToolPlaneSection,
    WorkspaceSection,
)
from telerobot.server.control.arm import Arm as ArmControl
from telerobot.server.control.barriers.clearance import CollisionConstraint
from telerobot.server.control.inputs import Intent, StickCommand
from telerobot.server.control.scene import Body, Moved, Scene
from telerobot.server.control.spatial import Pose
from telerobot.server.control.tick import Control
from telerobot.server.events import Events
from telerobot.server.perception.obstacle_map import ObstacleMap

from ..conftest import Arm, Run

PROMISE = 0.02
FAR = 0.3
"""Gaps are looked for within this [m]."""

TABLE = ObstacleSection(name="table", shape="box", xyz=(0.6, 0, 0.1), half_size=(0.3, 0.6, 0.1))
POLE = ObstacleSection(
    name="pole", shape="capsule", xyz=(0.5, 0.35, 0), to=(0.5, 0.35, 1), radius=0.05
)
BALL = ObstacleSection(name="ball", shape="sphere", xyz=(0.4, -0.4, 0.7), radius=0.1)
POST = ObstacleSection(name="post", shape="point", xyz=(0.85, 0.0, 0.5))
EVERYTHING = (TABLE, POLE, BALL, POST)


class Kept:
    """An arm that keeps clear, what is around it, and a run of it."""

    def __init__(
        self, arm: Arm, obstacles: tuple[ObstacleSection, ...], q=None, **avoidance
    ) -> None:
        given = AvoidanceSection(enabled=True, clearance=PROMISE, **avoidance)
        cell = altered(arm.cell, {"obstacles": obstacles, "avoidance": given})
        self.guard = CollisionConstraint(cell, arm.p.joints.acceleration, arm.p.joints.jerk)
        self.world = ObstacleMap.from_cell(cell, Events())
        control = Control([ArmControl(arm.p, arm.mechanism)], self.guard)
        arm = replace(arm, control=control, settings=replace(arm.settings, avoid=True))
        self.run = Run(arm, arm.posture("ready") if q is None else q)
        self.least: list[float] = []

    def gap(self, scene: Scene | None = None, own: bool = False) -> float:
        """Return the least gap to obstacles, or own links, less what is promised [m]."""
        scene = self.world.scene(0) if scene is None else scene
        around = self.guard.clearance.search
        room = np.full(len(around.capsules.each), FAR)
        placed = around.capsules.place(self.run.memory.commanded.motion.q[None])
        near = around.find(placed, scene, room, 0.0)
        wanted = (near.obstacle < 0) == own
        return float((near.gap - near.promise)[wanted].min(initial=FAR))

    def go(self, seconds: float, twist=None, scene: Scene | None = None) -> None:
        """Hold the stick for a while."""
        stick = None if twist is None else StickCommand(np.array(twist), np.eye(3))
        for _ in range(round(seconds / 0.01)):
            seen = self.world.scene(0) if scene is None else scene
            self.run.tick(stick=stick, scene=seen)
            self.least.append(self.gap(seen))

    @property
    def stopped(self) -> float:
        """Share of ticks in which the stored stop took over."""
        outputs = self.run.outputs
        return sum("verified_stop" in o.limits for o in outputs) / len(outputs)


def hostile(rng: np.random.Generator) -> list[float]:
    twist = rng.normal(size=6)
    return (1.5 * twist / np.linalg.norm(twist[:3])).tolist()


@pytest.mark.parametrize("seed", range(4))
def test_no_stick_brings_a_link_nearer_than_promised(pa10, seed):
    rng = np.random.default_rng(seed)
    kept = Kept(pa10, EVERYTHING)
    for _ in range(12):
        kept.go(float(rng.uniform(0.05, 0.8)), hostile(rng))
    assert min(kept.least) > 0.0
    assert any("clearance:" in name for o in kept.run.outputs for name in o.limits)
    assert kept.stopped < 0.01
    kept.run.observe()


def test_without_avoidance_the_same_stick_does(pa10):
    rng = np.random.default_rng(0)
    kept = Kept(pa10, EVERYTHING)
    kept.run.set(avoid=False)
    for _ in range(12):
        kept.go(float(rng.uniform(0.05, 0.8)), hostile(rng))
    assert min(kept.least) < -PROMISE
    assert kept.run.outputs[-1].gaps == ()


def test_the_best_gap_so_far_is_forgotten_while_drives_are_off(pa10):
    """What was once reached binds an arm that goes on, and none that was moved by others."""
    far = ObstacleSection(name="ball", shape="sphere", xyz=(0.9, 0.0, 0.5), radius=0.05)
    near = far.model_copy(update={"radius": 0.05 + Kept(pa10, (far,)).gap() + 0.005})
    kept = Kept(pa10, (near,))
    kept.go(0.02)
    found = dict(kept.run.memory.levels)
    assert found
    better = {pair: gap + 2e-5 for pair, gap in found.items()}
    kept.run.memory = kept.run.memory._replace(levels=better)
    kept.go(0.01)
    assert kept.run.memory.levels == pytest.approx(better, abs=1e-6)
    kept.run.tick(intent=Intent.SEED, scene=kept.world.scene(0))
    assert kept.run.memory.levels == pytest.approx(found, abs=1e-6)


@pytest.mark.parametrize("twist", [(0, 0, -0.5, 0, 0, 0), (0.3, 0.3, -0.4, 0, 0, 0)])
def test_driven_into_a_table_the_tool_stands_before_it_and_leaves_at_once(pa10, twist):
    kept = Kept(pa10, (TABLE,))
    kept.go(4.0, twist)
    assert 0.0 < min(kept.least) < 0.012
    # Straight at it the tool stands, and tilts; obliquely it glides on, up to where its reach ends.
    assert np.abs(kept.run.memory.commanded.motion.dq).max() < (0.3 if any(twist[:2]) else 0.03)
    height = kept.run.pose.p[2]
    kept.go(1.0, (0, 0, 0.3, 0, 0, 0))
    assert kept.run.pose.p[2] > height + 0.15


@pytest.mark.parametrize("inside", [0.001, 0.01, PROMISE + 0.005])
def test_an_arm_that_starts_inside_a_bound_does_not_get_deeper_and_can_leave(pa10, rng, inside):
    kept = Kept(pa10, ())
    tool = kept.run.pose.p
    near = ObstacleSection(name="ball", shape="sphere", xyz=(1.5, 0, 0), radius=0.05)
    gap = Kept(pa10, (near,)).gap()
    # Bring the ball up to the tool from ahead, until it is that far inside the promise.
    low, high = float(tool[0]), 1.5
    for _ in range(40):
        x = 0.5 * (low + high)
        ball = near.model_copy(update={"xyz": (x, float(tool[1]), float(tool[2]))})
        gap = Kept(pa10, (ball,)).gap()
        low, high = (x, high) if gap < -inside else (low, x)
    kept = Kept(pa10, (ball,))
    start = kept.gap()
    assert start == pytest.approx(-inside, abs=1e-4)
    for _ in range(10):
        kept.go(0.3, hostile(rng))
    assert min(kept.least) > start - 3e-4
    kept.run.observe()
    leaving = Kept(pa10, (ball,))
    leaving.go(1.5, (-0.2, 0, 0, 0, 0, 0))
    assert min(leaving.least) > start - 3e-4
    assert leaving.gap() > 0.1


def test_an_arm_inside_a_bound_stands_still_until_it_is_told_to_move(pa10):
    tool = Kept(pa10, ()).run.pose.p
    ball = ObstacleSection(
        name="ball", shape="sphere", xyz=tuple(tool + np.array([0.05, 0, 0])), radius=0.05
    )
    kept = Kept(pa10, (ball,))
    assert kept.gap() < 0.0
    start = kept.gap()
    kept.go(1.0)
    assert kept.run.pose.p == pytest.approx(tool, abs=1e-4)
    assert min(kept.least) > start - 1e-4


def test_far_from_everything_not_a_bit_is_changed(pa10):
    """Nothing but the bounds' own arithmetic may tell the two apart."""
    far = ObstacleSection(name="far", shape="sphere", xyz=(5, 5, 5), radius=0.1)
    with_it, without = Kept(pa10, (far,)), Kept(pa10, (far,))
    without.run.set(avoid=False)
    for kept in (with_it, without):
        kept.go(1.0, (0.1, 0.05, 0.05, 0, 0.1, 0))
    assert (with_it.run.memory.commanded.motion.q == without.run.memory.commanded.motion.q).all()


def test_links_are_kept_from_each_other(pa10):
    into_itself = np.array([-0.26, 1.57, -2.97, -2.32, 4.43, -0.93, -0.59])
    assert Kept(pa10, (), into_itself).gap(own=True) < -0.01
    kept = Kept(pa10, (), np.array([-0.24, 1.46, -2.71, -1.94, 4.04, -0.92, -0.54]))
    for _ in range(250):
        kept.run.tick(posture=into_itself)
        assert kept.gap(own=True) > 0.0
    named = {name for o in kept.run.outputs for name in o.limits if "clearance" in name}
    assert named
    assert named <= {"clearance:base:link5", "clearance:base:link6", "clearance:base:link7"}
    assert kept.stopped < 0.01


def test_what_may_touch_is_not_kept_apart(pa10):
    contact = AllowedContactSection(link="hand", other="post")
    kept = Kept(pa10, (POST,), allowed_contacts=(contact,))
    kept.go(3.0, (0.1, 0, 0.05, 0, 0, 0))
    assert not any("clearance:hand" in name for o in kept.run.outputs for name in o.limits)


def test_the_tool_stays_in_its_workspace(pa10, rng):
    box = WorkspaceSection(low=(0.5, -0.2, 0.3), high=(0.8, 0.2, 0.6))
    kept = Kept(pa10, (), workspace=box)
    low, high = np.array(box.low), np.array(box.high)
    for _ in range(15):
        kept.go(0.4, hostile(rng))
        p = kept.run.pose.p
        assert (p > low).all()
        assert (p < high).all()
    assert any("workspace" in o.limits for o in kept.run.outputs)
    kept.run.observe()


def test_the_tool_and_its_stops_stay_above_a_tilted_plane(pa10, rng):
    normal = np.array([-0.5, 0.3, 2.0]) / math.sqrt(4.34)
    start = pa10.mechanism.kinematics(pa10.posture("ready"), pa10.p.T_wrist_tool).T_world_mrf.p
    below = tuple((start - 0.15 * normal).tolist())
    plane = ToolPlaneSection(point=below, normal=(-0.5, 0.3, 2.0))
    kept = Kept(pa10, (), tool_planes=(plane,))
    heights = []
    for _ in range(15):
        kept.go(0.4, (0.1, -0.05, -0.25, *rng.uniform(-0.3, 0.3, 3)))
        heights.append(float(normal @ (kept.run.pose.p - plane.point)))
        stop = kept.run.memory.commanded.stop
        ends = [pa10.mechanism.kinematics(x, pa10.p.T_wrist_tool, None).T_world_mrf.p
                for x in stop.postures(np.linspace(0.0, stop.to_go_s, 5))]  # fmt: skip
        assert min(normal @ (p - plane.point) for p in ends) > 0.0
    assert 0.0 < min(heights) < 0.03
    assert any("workspace" in o.limits for o in kept.run.outputs)
    kept.run.observe()


def test_beside_things_the_tool_is_slow(pa10):
    speeds = []
    for near_speed in (None, 0.05):
        kept = Kept(pa10, (TABLE,), near_speed=near_speed, near_distance=0.15)
        kept.go(2.0, (0, 0, -0.4, 0, 0, 0))
        kept.go(0.6, (0, 0.4, 0, 0, 0, 0))
        speeds.append(_tool_speed(kept))
    assert speeds[1] < 0.12 < 0.3 < speeds[0]


def _tool_speed(kept: Kept) -> float:
    arm, motion = kept.run.arm, kept.run.memory.commanded.motion
    J = arm.mechanism.kinematics(motion.q, arm.settings.T_wrist_mrf).J
    return float(np.linalg.norm((J @ motion.dq)[:3]))


def _moving(scene: Scene, names: tuple[str, ...], speed: float) -> Scene:
    bound = np.array([speed if name in names else 0.0 for name in scene.names])
    return replace(scene, speed=bound)


def test_an_obstacle_that_comes_finds_the_arm_at_rest_or_not_closing(pa10, rng):
    kept = Kept(pa10, (BALL,))
    T, speed = 0.01, 0.3
    scene = kept.world.scene(0)
    centre = np.array([0.5, -0.9, 0.5])
    stick = hostile(rng)
    for i in range(500):
        if i % 40 == 0:
            stick = hostile(rng)
        way = kept.run.pose.p - centre
        centre = centre + speed * T * way / np.linalg.norm(way)
        here = replace(
            _moving(scene, ("ball",), speed),
            rounds=replace(scene.rounds, start=centre[None], end=centre[None]),
        )
        before = kept.gap(here)
        kept.run.tick(stick=StickCommand(np.array(stick), np.eye(3)), scene=here)
        after = kept.gap(here)
        if min(before, after) < 0.0:
            assert after >= before - 5e-5, f"own motion closes in tick {i}"
    kept.run.observe()


def test_an_obstacle_that_appears_on_the_arm_is_met_by_the_least_bad_stop(pa10):
    kept = Kept(pa10, (BALL,))
    scene = kept.world.scene(0)
    kept.go(0.5, (0.0, 0.3, 0.2, 0, 0, 0))
    ahead = kept.run.pose.p + np.array([0.0, 0.12, 0.08])
    here = replace(scene, rounds=replace(scene.rounds, start=ahead[None], end=ahead[None]))
    kept.go(1.0, (0.0, 0.3, 0.2, 0, 0, 0), here)
    assert any(o.stop_worsened for o in kept.run.outputs)
    assert min(kept.least) < -0.005
    kept.run.observe()
    start = kept.gap(here)
    kept.go(1.0, (0.0, -0.3, -0.2, 0, 0, 0), here)
    assert min(kept.least[-100:]) > start - 3e-4
    assert kept.gap(here) > 0.05


def test_the_lag_of_the_joints_is_taken_off_every_gap(pa10):
    gaps = []
    for lag in (0.0, 0.004):
        kept = Kept(pa10, (TABLE,))
        stick = StickCommand(np.array([0, 0, -0.3, 0, 0, 0]), np.eye(3))
        for _ in range(300):
            q = kept.run.memory.commanded.sent[1] - lag * np.array([0, 1.0, 0, 1.0, 0, 0, 0])
            kept.run.tick(stick=stick, scene=kept.world.scene(0), q_measured=q)
        gaps.append(kept.gap())
    assert gaps[1] > gaps[0] + 0.003


def test_equal_inputs_give_equal_bits(pa10):
    ends = []
    for _ in range(2):
        rng = np.random.default_rng(7)
        kept = Kept(pa10, EVERYTHING)
        for _ in range(5):
            kept.go(0.3, hostile(rng))
        ends.append(kept.run.memory.commanded.motion.q)
    assert (ends[0] == ends[1]).all()


def test_a_base_that_carries_the_arm_towards_things_leaves_it_more_room(pa10):
    gaps = []
    for speed in (0.0, 0.1):
        kept = Kept(pa10, (POST,))
        twist = np.array([speed, 0, 0, 0, 0, 0])
        base = Body(Pose.identity(), twist)
        moved = Moved(base, Body.standing(Pose.identity()), Pose.identity())
        for _ in range(300):
            command = StickCommand(np.array([0.3, 0, 0.1, 0, 0, 0]), np.eye(3))
            kept.run.tick(stick=command, scene=kept.world.scene(0), moved=moved)
            kept.least.append(kept.gap())
        gaps.append(min(kept.least))
    assert gaps[0] > 0.0
    assert gaps[1] > gaps[0] + 0.003
