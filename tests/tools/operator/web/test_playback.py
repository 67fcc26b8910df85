"""A recorded run for the console's time line: its pieces, its page, its player."""

import asyncio
import json
from contextlib import closing

import pytest
import trimesh
from aiohttp.test_utils import TestClient, TestServer
from telerobot.config.load import load_cell
from telerobot.protocols.topics import Role
from telerobot.tools.cli import main
from telerobot.tools.operator.web.scene import Scene, scene_of
from telerobot.tools.operator.web.server import Access, Listen, SceneServer
from telerobot.tools.recording.playback import PIECE_S, PlaybackServer, Timeline
from telerobot.tools.recording.recorder import Recorder
from telerobot.tools.recording.run_file import read_scene
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

STEPS = [
    {"at_s": 0.1, "cmd/joystick": {"twist": [0, 0.1, 0.05, 0, 0, 0.2]}, "for_s": 3.0},
    {"at_s": 4.1, "operator/mark": {"text": "<b>here</b>"}},
    {"at_s": 4.2, "operator/protective_stop": {}},
]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A simulation of a little more than one piece, and its file."""
    file = tmp_path_factory.mktemp("run") / "run.mcap"
    simulation = Simulation(
        load_cell("pa10"), Script.model_validate({"duration_s": 4.8, "step": STEPS}), file
    )
    simulation.run()
    return simulation, file


@pytest.fixture(scope="module")
def timeline(recorded):
    return Timeline(recorded[1])


def test_pieces_hold_states_as_they_were_and_begin_with_all_from_before(recorded, timeline):
    of = {state.tick: state for state in recorded[0].states}
    pieces = [json.loads(timeline.piece(i)) for i in range(2)]
    assert timeline.piece(2) is None
    shown = [m for piece in pieces for m in piece if m["type"] == "state"]
    assert 20 * timeline.length_s < len(shown) < 30 * timeline.length_s
    for message in shown:
        assert message["state"]["q"] == list(of[message["state"]["tick"]].q)
    assert {m["type"] for m in pieces[1] if m["t"] < PIECE_S} == {"state", "truth"}
    times = [m["t"] for m in pieces[0]]
    assert times == sorted(times)
    stopped = next(m for m in reversed(shown) if m["state"]["mode"] == "hold")
    assert "Protective stop" in stopped["why"]["sentence"]


def test_events_are_sentences_with_their_time(timeline):
    said = {event["name"]: event for event in timeline.events}
    assert said["protective_stop"]["sentence"].startswith("Protective stop")
    assert said["marked"]["t"] < said["protective_stop"]["t"] < timeline.length_s


def test_a_file_without_states_is_said_in_one_line(tmp_path, capsys):
    file = tmp_path / "empty.mcap"
    recorder = Recorder(file)
    recorder.about(load_cell("pa10"))
    recorder.close()
    assert main(["console", str(file)]) == 2
    assert "holds no states" in capsys.readouterr().err
    file.write_bytes(b"junk")
    assert main(["console", str(file)]) == 2
    error = capsys.readouterr().err
    assert "not an MCAP recording" in error
    assert "Traceback" not in error


def test_the_page_is_behind_the_same_door_and_takes_nothing(timeline):
    async def run():
        access = Access("pa10")
        server = PlaybackServer(timeline, access, Listen("127.0.0.1", 0), secure=False)
        async with TestClient(TestServer(server.application())) as client:
            server.port = client.port
            for path in ("/", "/run.json", "/pieces/0.json", "/scene.json"):
                assert (await client.get(path)).status == 401
            await client.get("/", params={"key": access.keys[Role.OBSERVER]})
            page = await client.get("/")
            assert "playback/app.js" in await page.text()
            policy = page.headers["Content-Security-Policy"]
            assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self';")
            assert (await (await client.get("/run.json")).json())["cell"] == "pa10"
            assert len(await (await client.get("/pieces/1.json")).json()) > 10
            for path in ("/pieces/2.json", "/pieces/-1.json", "/pieces/0.json.py", "/ws"):
                assert (await client.get(path)).status == 404
            assert (await client.get("/scene.json")).status == 200

    asyncio.run(run())


def test_the_player_shows_each_message_once_and_begins_anew_wherever_it_is_put(in_node):
    program = """
        const { createPlayer } = await load("playback/player.js");
        const log = [], asked = [];
        const piece = (i) => [0, 1, 2, 3].map((k) => ({ t: 4 * i + k, n: 4 * i + k }));
        const player = createPlayer({
          length: 10, pieceLength: 4,
          load: async (i) => { asked.push(i); return piece(i); },
          show: (messages, anew) => log.push([anew, messages.map(({ n }) => n)]),
        });
        const settled = () => new Promise((done) => setTimeout(done));
        player.step(0.1);
        const before = [player.time, log.length];
        await settled();
        player.play();
        for (const _ of Array(8)) { player.step(0.5); await settled(); }
        const played = log.splice(0);
        player.pause();
        player.step(5);
        const paused = player.time;
        player.seek(9.5);
        player.step(0); await settled(); player.step(0);
        const jumped = log.splice(0);
        player.play();
        player.step(3);
        return { before, played, paused, jumped, end: [player.time, player.playing], asked };
    """
    told = in_node(program, {})
    assert told["before"] == [0, 0]
    assert [n for _, some in told["played"] for n in some] == [0, 1, 2, 3, 4]
    assert told["paused"] == 4
    assert told["jumped"] == [[True, [8, 9]]]
    assert told["end"] == [10, False]
    assert told["asked"] == [0, 1, 2]


def test_a_recording_carries_the_meshes_that_its_page_draws(small, tmp_path):
    mesh = small.urdf.parent / "link.stl"
    trimesh.creation.icosphere(radius=0.1).export(mesh)
    urdf = small.urdf.read_text()
    visual = '<visual><geometry><mesh filename="link.stl"/></geometry></visual>'
    small.urdf.write_text(urdf.replace('<link name="l1">', f'<link name="l1">{visual}'))
    cell, file = load_cell(small.cell), tmp_path / "run.mcap"
    drawn = scene_of(cell)
    with closing(Recorder(file)) as recorder:
        recorder.about(cell)
    mesh.unlink()
    small.urdf.unlink()
    scene = read_scene(file)
    assert scene == Scene(json.loads(json.dumps(drawn.description)), drawn.files)
    (address,) = scene.files

    async def run():
        access = Access("small")
        server = SceneServer(cell, access, Listen("127.0.0.1", 0), False, scene)
        async with TestClient(TestServer(server.application())) as client:
            server.port = client.port
            await client.get("/", params={"key": access.keys[Role.OBSERVER]})
            told = await (await client.get("/scene.json")).json()
            assert told["links"][1]["shapes"][0]["url"] == address
            assert await (await client.get(address)).read() == scene.files[address]
            assert (await client.get("/meshes/1.glb")).status == 404

    asyncio.run(run())
