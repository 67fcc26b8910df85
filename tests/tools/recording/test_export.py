"""`telerobot export`: a recorded run as tables that others' tools read."""

import io
import json

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.recorder import MEMORY, TICK
from telerobot.tools.cli import main
from telerobot.tools.recording.live import Viewer
from telerobot.tools.recording.recorder import Recorder
from telerobot.tools.recording.run_file import read_run
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

av = pytest.importorskip("av", reason="pip install 'telerobot[export]'")
pq = pytest.importorskip("pyarrow.parquet", reason="pip install 'telerobot[export]'")

STEPS = [{"at_s": 0.1, "cmd/joystick": {"twist": [0.03, 0, 0.01, 0, 0, 0]}, "for_s": 0.6}]


def picture(brightness):
    frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), brightness, np.uint8), format="rgb24")
    file = io.BytesIO()
    with av.open(file, "w", format="image2pipe") as container:
        stream = container.add_stream("png", rate=1)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "rgb24"
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return file.getvalue()


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A simulation, its recording, and the same ticks with a camera's pictures."""
    folder = tmp_path_factory.mktemp("run")
    cell = load_cell("pa10")
    script = Script.model_validate({"duration_s": 0.8, "step": STEPS})
    simulation = Simulation(cell, script, folder / "run.mcap")
    simulation.run()
    seen, viewer, memory, ticks = Recorder(folder / "seen.mcap"), Viewer(cell), b"", 0
    seen.about(cell)
    for message in read_run(folder / "run.mcap", (TICK, MEMORY)):
        if message.topic == MEMORY:
            memory = message.data
            continue
        if ticks % 10 == 0:
            topic, image = viewer.of_picture("wrist", picture(2 * ticks), message.stamp_ns)
            seen.proto(topic, message.stamp_ns, image)
        seen.ticks(message.stamp_ns, message.data, memory)
        memory, ticks = b"", ticks + 1
    seen.close()
    return simulation, folder


def test_arrays_hold_what_the_daemon_told(flown, capsys):
    simulation, folder = flown
    assert main(["export", str(folder / "run.mcap"), "--to", "numpy"]) == 0
    run = np.load(folder / "run.numpy" / "run.npz")
    states = {state.tick: state for state in simulation.states}
    told = [states[tick] for tick in run["tick"].tolist()]
    np.testing.assert_array_equal(run["state.q"], [s.q for s in told])
    np.testing.assert_array_equal(run["action.q"], [s.q_command for s in told])
    stick = [s.sources["joystick"] for s in told]
    np.testing.assert_array_equal(run["action.sources.joystick"], stick)
    assert np.abs(run["action.sources.joystick"]).max() > 0.01
    events = json.loads((folder / "run.numpy" / "events.json").read_text())
    enabled = next(e for e in events if e["detail"] == "ready -> enabled")
    assert told[enabled["row"]].mode == "enabled"


def test_parquet_has_a_row_for_each_tick_and_its_pictures(flown):
    _, folder = flown
    assert main(["export", str(folder / "seen.mcap"), "--to", "parquet"]) == 0
    table = pq.read_table(folder / "seen.parquet" / "run.parquet")
    seen = [i for i, data in enumerate(table["pictures.wrist"].to_pylist()) if data is not None]
    assert seen == list(range(0, table.num_rows, 10))
    assert len(table["action.q"][0]) == 7


def test_a_lerobot_data_set_is_what_its_info_says(flown):
    """Read by the rules of its documentation: paths from `info.json`, one frame a row."""
    _, folder = flown
    out = folder / "set"
    command = ["export", str(folder / "seen.mcap"), "--to", "lerobot", "--out", str(out)]
    assert main([*command, "--fps", "20", "--task", "push"]) == 0
    info = json.loads((out / "meta/info.json").read_text())
    episode = json.loads((out / "meta/episodes.jsonl").read_text())
    where = {"episode_chunk": 0, "episode_index": 0}
    table = pq.read_table(out / info["data_path"].format(**where))
    assert table.num_rows == info["total_frames"] == episode["length"]
    assert episode["tasks"] == ["push"]
    in_data = {n: f for n, f in info["features"].items() if f["dtype"] != "video"}
    assert set(table.column_names) == set(in_data)
    for name, feature in in_data.items():
        first = table[name][0].as_py()
        assert (len(first) if isinstance(first, list) else 1) == feature["shape"][0]
        if feature["names"]:
            assert len(feature["names"]) == feature["shape"][0]
    stamps = np.array(table["timestamp"].to_pylist())
    np.testing.assert_allclose(np.diff(stamps), 1.0 / info["fps"], atol=1e-6)
    key = "observation.images.wrist"
    with av.open(str(out / info["video_path"].format(video_key=key, **where))) as video:
        frames = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    assert len(frames) == info["total_frames"]
    assert list(frames[0].shape) == info["features"][key]["shape"]
    brightness = [float(frame.mean()) for frame in frames]
    assert brightness[-1] > brightness[0] + 50  # each frame has the newest picture of its time


def test_frames_that_are_no_share_of_the_ticks_are_refused(flown, capsys):
    _, folder = flown
    command = ["export", str(folder / "run.mcap"), "--to", "lerobot", "--out", str(folder / "no")]
    assert main([*command, "--fps", "30"]) == 2
    assert "--fps 30" in capsys.readouterr().err
