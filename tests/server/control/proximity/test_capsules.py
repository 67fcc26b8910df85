"""The arm as capsules, against Pinocchio, finite differences and points on the true shapes."""

import numpy as np
import pinocchio as pin
import pytest
from telerobot.config.load import Cell, ConfigError, altered
from telerobot.config.schema.surroundings import AvoidanceSection, LinkCapsuleSection
from telerobot.server.control.proximity.capsules import Capsules
from telerobot.server.control.spatial import Pose


@pytest.fixture(params=["pa10", "ur5e"])
def arm(request):
    return request.getfixturevalue(request.param)


def test_frames_agree_with_pinocchio_at_any_posture_and_base(arm, rng):
    chain = Capsules(arm.cell).forest
    model = arm.mechanism.model
    data = model.createData()
    q = np.array([arm.random_posture(rng) for _ in range(20)])
    base = Pose.from_xyz_rpy((0.3, -0.2, 0.5), (0.4, -0.3, 1.0))
    frames = chain.frames(q, base)
    for i in range(len(q)):
        pin.forwardKinematics(model, data, q[i])
        for j in range(chain.n):
            placed = base @ Pose(data.oMi[j + 1].rotation, data.oMi[j + 1].translation)
            assert frames[i, j, :, :3] == pytest.approx(placed.R, abs=1e-12)
            assert frames[i, j, :, 3] == pytest.approx(placed.p, abs=1e-12)


def test_levers_are_how_far_the_ends_go_when_one_joint_turns(arm, rng):
    links = Capsules(arm.cell)
    q = arm.random_posture(rng)
    lever = links.levers(links.place(q[None]))
    h = 1e-6
    for j in range(arm.p.n):
        step = h * np.eye(arm.p.n)[j]
        ends = links.place(np.array([q + step, q - step])).ends
        speed = np.linalg.norm(ends[0] - ends[1], axis=-1).max(axis=-1) / (2 * h)
        assert lever[:, j] == pytest.approx(speed, abs=1e-8)


def test_no_point_of_a_link_is_moved_further_than_its_lever_allows(arm, rng):
    links = Capsules(arm.cell)
    far = [max(np.linalg.norm(c.start), np.linalg.norm(c.end)) for c in links.each]
    lever = np.array([links.reach(c.body, x) for c, x in zip(links.each, far, strict=True)])
    for _ in range(50):
        q, turn = arm.random_posture(rng), rng.uniform(-0.5, 0.5, arm.p.n)
        ends = links.place(np.array([q, q + turn])).ends
        moved = np.linalg.norm(ends[1] - ends[0], axis=-1).max(axis=-1)
        assert (moved <= lever @ np.abs(turn) + 1e-12).all()


def test_every_point_of_the_collision_shapes_lies_inside_a_capsule(arm, rng):
    links = Capsules(arm.cell)
    description = arm.cell.robot.description()
    model = pin.buildModelFromXML(description)
    geometry = pin.buildGeomFromUrdfString(model, description, pin.GeometryType.COLLISION)
    data, shapes = model.createData(), geometry.createData()
    q = arm.random_posture(rng)
    pin.updateGeometryPlacements(model, data, geometry, shapes, q)
    a, b = np.moveaxis(links.place(q[None]).ends[0], 1, 0)
    for shape, placed in zip(geometry.geometryObjects, shapes.oMg, strict=True):
        angle = rng.uniform(0, 2 * np.pi, 40)
        height = rng.uniform(-1, 1, 40) * getattr(shape.geometry, "halfLength", 0.0)
        r = shape.geometry.radius
        surface = np.column_stack([r * np.cos(angle), r * np.sin(angle), height])
        for p in surface @ placed.rotation.T + placed.translation:
            part = ((p - a) * (b - a)).sum(1) / np.maximum(((b - a) ** 2).sum(1), 1e-12)
            nearest = a + np.clip(part, 0, 1)[:, None] * (b - a)
            assert (np.linalg.norm(p - nearest, axis=1) - links.radius).min() < 1e-9


def test_a_ball_at_the_end_of_a_rod_is_no_capsule_of_its_own(pa10):
    links = Capsules(pa10.cell)
    assert links.links == (
        "base", "link1", "link2", "link3", "link4", "link5", "link6", "link7", "hand", "hand",
    )  # fmt: skip


def test_the_cell_may_add_to_the_shape_of_a_link(pa10):
    tool = LinkCapsuleSection(link="flange", start=(0, 0, 0.1), end=(0, 0, 0.3), radius=0.02)
    links = Capsules(_with(pa10.cell, tool))
    assert links.links[-1] == "flange"
    q = pa10.posture("ready")
    T = pa10.mechanism.pose_wrist(q)
    ends = links.place(q[None]).ends[0, -1]
    assert ends[1] == pytest.approx(T.R @ np.array([0, 0, 0.3]) + T.p, abs=1e-12)


def test_a_capsule_for_a_link_that_is_not_there_is_named(pa10):
    tool = LinkCapsuleSection(link="flnge", start=(0, 0, 0.1), end=(0, 0, 0.3), radius=0.02)
    with pytest.raises(ConfigError, match=r"avoidance.capsules\[0\].link: value 'flnge'"):
        Capsules(_with(pa10.cell, tool))


def _with(cell: Cell, *capsules: LinkCapsuleSection) -> Cell:
    avoidance = AvoidanceSection(capsules=capsules)
    return altered(cell, {"avoidance": avoidance})
