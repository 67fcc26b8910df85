"""The page's own mathematics, run in Node, against Python's."""

import json

import numpy as np
import pinocchio as pin
import pytest
from laboratory.vendor.fetch import missing
from telerobot.config.load import load_cell
from telerobot.protocols.messages.perception import ScanPoints
from telerobot.server.commands.haptics import SLIP
from telerobot.server.control.backbone.tunnels import Arcs, Turn
from telerobot.server.control.spatial import Pose, pose_error
from telerobot.tools.operator.web.scene import describe
from telerobot.tools.operator.web.streams import told_scan

FORWARD = """
    const { forward } = await load("scene/geometry/kinematics.js");
    return given.postures.map((q) => forward(given.description, q));
"""


@pytest.mark.parametrize("name", ["pa10_trio", "ur5e", "ranger", "snake_space"])
def test_the_page_puts_links_where_the_robot_has_them(in_node, name):
    cell, random = load_cell(name), np.random.default_rng(3)
    description = describe(cell)
    lower, upper = (
        np.array([joint[bound] for joint in description["joints"]]) for bound in ("lower", "upper")
    )
    postures = random.uniform(lower, upper, (5, len(lower)))
    given = {"description": description, "postures": postures.tolist()}
    for q, links in zip(postures, in_node(FORWARD, given), strict=True):
        where = {link["name"]: T for link, T in zip(description["links"], links, strict=True)}
        first = 0
        for part in cell.parts:
            model = pin.buildModelFromXML(part.robot.description())
            data, own = model.createData(), pin.neutral(model)
            for i, joint in enumerate(part.robot.joints):
                own[model.joints[model.getJointId(joint.name)].idx_q] = q[first + i]
            first += len(part.robot.joints)
            pin.framesForwardKinematics(model, data, own)
            base = part.config.mechanism.T_world_base
            T_world_base = Pose.from_xyz_rpy(base.xyz, base.rpy)
            for link in part.robot.links():
                placed = data.oMf[model.getFrameId(link)]
                T = T_world_base @ Pose(placed.rotation, placed.translation)
                told = where[part.prefix + link]
                assert told[:3] == pytest.approx(T.p.tolist(), abs=1e-9)
                R = pin.Quaternion(np.array(told[3:])).toRotationMatrix()
                assert pytest.approx(T.R, abs=1e-9) == R


def test_poses_go_through_the_pages_quaternions_unchanged(in_node):
    random = np.random.default_rng(5)
    poses = np.hstack((random.normal(size=(200, 3)), random.uniform(-3.1, 3.1, (200, 3))))
    poses[:20, 4] = np.pi / 2  # where roll and yaw are one
    program = """
        const { fromRpy, toRpy } = await load("scene/geometry/poses.js");
        return given.map((pose) => [fromRpy(pose), toRpy(fromRpy(pose))]);
    """
    for pose, (seven, back) in zip(poses, in_node(program, poses.tolist()), strict=True):
        T = Pose.from_xyz_rpy(tuple(pose[:3]), tuple(pose[3:]))
        assert pin.Quaternion(np.array(seven[3:])).toRotationMatrix() == pytest.approx(T.R)
        again = Pose.from_xyz_rpy(tuple(back[:3]), tuple(back[3:]))
        assert again.p == pytest.approx(T.p)
        assert pytest.approx(T.R, abs=1e-6) == again.R


def test_lines_of_gaps_end_at_the_nearest_points(in_node):
    random = np.random.default_rng(7)
    ends = random.uniform(-1.0, 1.0, (60, 4, 3))
    ends[:10, 3] = ends[:10, 2]  # a point
    ends[10:20, 3] = ends[10:20, 2] + 2.0 * (ends[10:20, 1] - ends[10:20, 0])  # parallel
    program = """
        const { segments, segmentBox } = await load("scene/geometry/nearest.js");
        const half = [0.2, 0.3, 0.1];
        return given.map(([a, b, c, d]) => [segments(a, b, c, d), segmentBox(a, b, half)]);
    """
    t = np.linspace(0.0, 1.0, 201)
    for (a, b, c, d), (pair, boxed) in zip(ends, in_node(program, ends.tolist()), strict=True):
        one, other = (p + np.outer(t, q - p) for p, q in ((a, b), (c, d)))
        least = np.linalg.norm(one[:, None] - other[None], axis=2).min()
        found = np.linalg.norm(np.subtract(*pair))
        assert found <= least + 1e-9
        assert found >= least - 0.02
        outside = np.linalg.norm(np.maximum(np.abs(one) - [0.2, 0.3, 0.1], 0.0), axis=1).min()
        distance = np.linalg.norm(np.subtract(*boxed))
        assert distance <= outside + 1e-6
        assert distance >= outside - 0.02


@pytest.mark.parametrize("anew_s", [None, 0.6], ids=["one run", "a daemon that starts anew"])
def test_what_comes_in_bunches_is_drawn_evenly_and_little_late(in_node, anew_s):
    random = np.random.default_rng(11)
    sent = np.arange(0.0, 6.0, 1 / 60)
    late = 0.004 + 0.025 * random.random(len(sent)) ** 2
    late[100:103] = (0.05, 0.034, 0.017)  # a bunch
    given = {
        "sent": (sent if anew_s is None else np.where(sent < anew_s, sent, sent - anew_s)).tolist(),
        "come": np.maximum.accumulate(sent + 7.0 + late).tolist(),
    }
    program = """
        const { createTimeline } = await load("scene/geometry/timeline.js");
        const timeline = createTimeline();
        const drawn = [];
        let i = 0;
        for (let now = 7.1; now < 12.9; now += 1 / 60) {
          for (; given.come[i] <= now; i += 1) timeline.push(given.sent[i], {}, given.come[i]);
          drawn.push([now - 7, timeline.sample(now).time]);
        }
        return drawn;
    """
    now, drawn = np.array(in_node(program, given)).T
    drawn[now > 0.7] += anew_s or 0.0
    settled = now > 3.0
    assert np.diff(drawn)[settled[1:]] == pytest.approx(1 / 60, rel=0.08)
    assert (now - drawn)[settled].max() < 0.08


def test_an_obstacle_that_only_moves_is_not_made_anew(in_node):
    if missing():
        pytest.skip("the page's JavaScript is not fetched: make venv")
    program = """
        const { createSurroundings } = await load("scene/things/surroundings.js");
        const { createMaterials } = await load("scene/stage/kit.js");
        const label = { at() {}, setRole() {}, remove() {} };
        const scene = createSurroundings(given, createMaterials(), { add: () => label });
        const box = {
            name: "crate", shape: "box", xyz: [1, 0, 0], rpy: [0, 0, 0], half_size: [0.1, 0.1, 0.1],
        };
        const seen = [];
        for (const news of [
            box, { name: "crate", shape: null, xyz: [2, 0, 0] },
            { ...box, half_size: [0.2, 0.1, 0.1] },
            { name: "nobody", shape: null, xyz: [0, 0, 0] }, { name: "crate", remove: true },
        ]) {
            scene.news(news);
            const { told, object } = scene.obstacles.get("crate") ?? {};
            seen.push([object?.uuid ?? null, told?.xyz ?? null, object?.position.x ?? null]);
        }
        return { seen, names: [...scene.obstacles.keys()], shown: scene.object.children.length };
    """
    result = in_node(program, {"obstacles": [], "cameras": [], "tasks": [], "rig": None})
    (new, _, _), (moved, xyz, x), (larger, _, _), (kept, _, _), gone = result["seen"]
    assert moved == new
    assert (xyz, x) == ([2, 0, 0], 2)
    assert larger not in (None, new)
    assert kept == larger
    assert gone == [None, None, None]
    assert (result["names"], result["shown"]) == ([], 0)


def test_a_contour_stands_where_its_cells_are(in_node):
    if missing():
        pytest.skip("the page's JavaScript is not fetched: make venv")
    program = """
        const { platesOf } = await load("scene/things/contour.js");
        return platesOf(given);
    """
    nearest = [None, 1200, None, 900, None, None]
    given = {"rows": 2, "columns": 3, "cell": 0.1, "nearest_mm": nearest}
    plates = in_node(program, given)
    assert plates == [pytest.approx([1.2, 0.0, 0.05]), pytest.approx([0.9, -0.1, 0.15])]


@pytest.mark.parametrize(("takes_ms", "share"), [(200, 0.5), (2000, 0.5)])
def test_a_page_that_draws_slowly_asks_for_one_picture_at_a_time_and_rests_as_long(
    in_node, takes_ms, share
):
    program = """
        const { createPace } = await load("scene/stage/pace.js");
        let now = 0, asked = 0, busy = 0, most = 0, queue = [];
        const pace = createPace(() => {
          const end = now + given;
          queue.push(end);
          return () => now >= end;
        });
        for (now = 0; now < 30000; now += 1000 / 60) {
          queue = queue.filter((end) => end > now);
          busy += queue.length > 0 ? 1 : 0;
          asked += 1;
          pace.took(now);
          if (!pace.may(now)) continue;
          pace.begun(now);
          most = Math.max(most, queue.length);
        }
        return { most, drawn: busy / asked };
    """
    result = in_node(program, takes_ms)
    assert result["most"] == 1
    assert result["drawn"] == pytest.approx(share, abs=0.08)


def test_a_page_that_draws_quickly_draws_whenever_it_may(in_node):
    program = """
        const { createPace } = await load("scene/stage/pace.js");
        const pace = createPace(() => () => true);
        let drawn = 0;
        for (let now = 0; now < 1000; now += 10) {
          pace.took(now);
          if (pace.may(now)) {
            pace.begun(now);
            drawn += 1;
          }
        }
        return drawn;
    """
    assert in_node(program, None) == 100


def test_a_handle_that_is_dragged_live_leads_the_tool_there_and_never_far_ahead(in_node):
    random = np.random.default_rng(13)
    poses = np.hstack((random.normal(size=(200, 3)), random.uniform(-3.1, 3.1, (200, 3))))
    tools = poses + random.normal(size=poses.shape) * np.geomspace(1e-4, 1.0, 200)[:, None]
    program = """
        const { LEAD, leadTo } = await load("scene/geometry/lead.js");
        return [LEAD, given.map(([handle, tool]) => leadTo(handle, tool))];
    """
    given = np.stack((poses, tools), axis=1).tolist()
    (most, turn_most), leads = in_node(program, given)
    assert most < SLIP[0]
    assert turn_most < SLIP[1]
    arrived = 0
    for handle, tool, lead in zip(poses, tools, leads, strict=True):
        wanted, at, led = (
            Pose.from_xyz_rpy(tuple(p[:3]), tuple(p[3:])) for p in (handle, tool, lead)
        )
        way, ahead = pose_error(wanted, at), pose_error(led, at)
        part = min(1.0, most / np.linalg.norm(way[:3]), turn_most / np.linalg.norm(way[3:]))
        assert ahead == pytest.approx(part * way, abs=1e-6)
        arrived += part == 1.0
    assert 20 < arrived < 180


def test_points_of_a_scan_are_read_where_the_scanner_saw_them(in_node):
    if missing():
        pytest.skip("the page's JavaScript is not fetched: make venv")
    points = np.random.default_rng(17).integers(-(2**31), 2**31, (50, 3), dtype=np.int64)
    sent = ScanPoints(tick=1, points_mm=points.astype("<i4").tobytes())
    program = """
        const { pointsOf } = await load("scene/things/scan.js");
        return [...pointsOf(given.scan.points_mm)];
    """
    read = in_node(program, json.loads(told_scan(sent).text))
    assert np.reshape(read, (-1, 3)) == pytest.approx(points / 1000.0, rel=1e-6)


def test_programs_are_used_only_once_the_browser_has_compiled_them(in_node):
    program = """
        const { createCompiler } = await load("scene/stage/compiler.js");
        const told = [];
        const scene = { things: [], traverse(each) { this.things.forEach(each); } };
        let done = false;
        const renderer = {
            info: { programs: [1, 2].map((n) => ({ getUniforms: () => told.push(`asked ${n}`) })) },
            compile: () => { told.push("compiled"); done = false; },
        };
        const compiler = createCompiler(renderer, scene, null, () => () => done);
        const turns = (count) => told.push(...[...Array(count)].map(() => compiler.ready()));
        turns(1);
        scene.things.push({ material: [{}, {}] }, {});
        turns(3);
        done = true;
        turns(4);
        scene.things.push({ material: {} });
        turns(1);
        return told;
    """
    assert in_node(program, None) == [
        True, "compiled", False, False, False, "asked 2", "asked 1", False, False, True, True,
        "compiled", False,
    ]  # fmt: skip


def test_the_page_draws_a_told_tunnel_where_it_is(in_node):
    T = Pose.from_xyz_rpy((0.1, 0.6, -0.2), (0.4, -0.3, 1.2))
    pieces = [[0.30, 0.8, -0.5, 1.1], [0.20, 0.0, 0.0, 0.0], [0.25, 0.0, 0.9, -0.7]]
    program = """
        const { centreLine } = await load("scene/geometry/tunnel.js");
        return centreLine(given.entrance, given.pieces, 1, 0.01);
    """
    entrance = [*T.p.tolist(), *T.R[:, 1].tolist(), *T.R[:, 2].tolist()]
    (row,) = in_node(program, {"entrance": entrance, "pieces": pieces})
    frames = np.array(row)
    arcs = Arcs.from_entrance(T, [Turn(*piece) for piece in pieces[:2]])
    assert len(frames) == 51
    assert frames[:, :3] == pytest.approx(arcs.at(np.linspace(0.0, 0.5, 51))[0], abs=1e-12)
    tangents = np.cross(frames[:, 3:6], frames[:, 6:9])
    assert tangents == pytest.approx(arcs.at(np.linspace(0.0, 0.5, 51))[1], abs=1e-12)


def test_the_page_draws_no_walls_across_a_gap_and_the_next_passage_where_it_begins(in_node):
    to = ((-0.2, 0.9, 0.1), (0.3, -0.4, 2.0))
    pieces = [[0.10, 0.4, 0.0, 0.0], [0.5, *to[0], *to[1]], [0.20, 0.0, 0.9, -0.7]]
    program = """
        const { centreLine } = await load("scene/geometry/tunnel.js");
        return centreLine(given.entrance, given.pieces, 0, 0.01);
    """
    entrance = [0.0, 0.6, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    first, second = in_node(program, {"entrance": entrance, "pieces": pieces})
    assert len(first) == 11
    arcs = Arcs.from_entrance(Pose.from_xyz_rpy(*to), [Turn(*pieces[2])])
    points, tangents = arcs.at(np.linspace(0.0, 0.2, 21))
    frames = np.array(second)
    assert frames[:, :3] == pytest.approx(points, abs=1e-12)
    assert np.cross(frames[:, 3:6], frames[:, 6:9]) == pytest.approx(tangents, abs=1e-12)
