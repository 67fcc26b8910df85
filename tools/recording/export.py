"""`telerobot export`: a recorded run as arrays, parquet or a LeRobot data set."""

import argparse
import bisect
import io
import json
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...config.load import Cell, ConfigError
from ...server.control.spatial import Array
from ..host.progress import counted
from .live import picture_in
from .replay import Replay, Replayed
from .run_file import RecordError, read_cell, read_run

# --- A recorded run as a table with one row for each tick: state, action, wrench, events, pictures
#
# State is what was measured, action what the daemon did with what was asked: the commanded
# joints, and each source's twist. All of it is computed again from the recorded inputs
# (`replay`), so that a row holds what one tick knew, and nothing of another one.
PICTURES: Final = "pictures/"


@dataclass
class TickTable:
    """Columns over k ticks, and what lies beside them."""

    cell: Cell
    columns: dict[str, Array] = field(default_factory=dict)
    """Each (k,) or (k, m); NaN where a value was not there."""
    events: list[dict[str, object]] = field(default_factory=list)
    """Events, each with the `row` that it belongs to."""
    pictures: dict[str, list[tuple[int, bytes]]] = field(default_factory=dict)
    """Of each camera: row and picture as it was recorded (PNG)."""

    @property
    def rows(self) -> int:
        return len(self.columns["time_s"])


def table_of(path: Path, cell: Cell) -> TickTable:
    """Return a recorded run as a table. Raises `RecordError` for one without ticks."""
    rows: list[dict[str, Array]] = []
    stamps: list[int] = []
    row_of: dict[int, int] = {}
    for tick in counted(Replay(path, cell).run(), "computed", "ticks"):
        if tick.outputs:
            row_of[tick.record.tick] = len(rows)
            stamps.append(tick.stamp_ns)
            rows.append(_row(cell, tick))
    if not rows:
        raise RecordError(f"{path}: no tick can be computed again: nothing to export")
    table = TickTable(cell, {name: np.array([row[name] for row in rows]) for name in rows[0]})
    for message in read_run(path):
        if message.topic == "event":
            event = message.json()
            row = row_of.get(event["tick"])
            if row is not None:
                told = {name: event[name] for name in ("name", "severity", "detail")}
                table.events.append({"row": row, "time_s": event["time_s"], **told})
        elif message.topic.startswith(PICTURES):
            # A row has the newest picture that had come by then.
            row = bisect.bisect_left(stamps, message.stamp_ns)
            if row < len(rows):
                camera = message.topic.removeprefix(PICTURES)
                table.pictures.setdefault(camera, []).append((row, picture_in(message.data)))
    return table


def _row(cell: Cell, tick: Replayed) -> dict[str, Array]:
    """Return one tick's values; those of several arms one after the other."""
    six = np.full(6, np.nan)
    row = {
        "time_s": np.float64(tick.record.time_s),
        "tick": np.int64(tick.record.tick),
        "state.q": np.concatenate([i.q_measured for i in tick.inputs]),
        "action.q": np.concatenate([o.q for o in tick.outputs]),
        "action.dq": np.concatenate([o.dq for o in tick.outputs]),
        "action.command": np.concatenate([o.command for o in tick.outputs]),
    }
    for part, inputs, output in zip(cell.parts, tick.inputs, tick.outputs, strict=True):
        of = part.prefix
        row[f"state.{of}pose_mrf"] = np.array(output.T_world_mrf_measured.to_xyz_rpy())
        row[f"state.{of}wrench_mrf"] = six if output.wrench is None else output.wrench
        sensor = inputs.wrench_sensor
        row[f"state.{of}wrench_sensor"] = six if sensor is None else sensor
        row[f"action.{of}twist"] = output.twist
        row[f"action.{of}granted"] = np.float64(output.granted)
        for source, twist in output.twists.items():
            row[f"action.{of}sources.{source}"] = twist
    return {name: np.asarray(value) for name, value in row.items()}


# --- A run as `run.npz`: a column each, events as JSON, pictures in folders beside it -------------
def write_numpy(table: TickTable, folder: Path) -> None:
    """Write a table. Raises `OSError`."""
    folder.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(folder / "run.npz", allow_pickle=False, **table.columns)
    (folder / "events.json").write_text(json.dumps(table.events, indent=1), encoding="utf-8")
    for camera, pictures in table.pictures.items():
        (folder / camera).mkdir(exist_ok=True)
        for row, data in pictures:
            (folder / camera / f"{row:08d}.png").write_bytes(data)


# --- A run as `run.parquet`, a row for each tick; events as a table of their own ------------------
def arrow() -> tuple[Any, Any]:
    """Return pyarrow and its parquet. Raises `ConfigError` where they are not installed."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise ConfigError(
            "parquet and LeRobot need pyarrow: pip install 'telerobot[export]'"
        ) from None
    return pa, pq


def write_parquet(table: TickTable, folder: Path) -> None:
    """Write a table. Raises `OSError`, `ConfigError`."""
    pa, pq = arrow()
    folder.mkdir(parents=True, exist_ok=True)
    columns = {name: column(pa, values) for name, values in table.columns.items()}
    for camera, pictures in table.pictures.items():
        bytes_of = dict(pictures)
        columns[f"pictures.{camera}"] = pa.array(
            [bytes_of.get(row) for row in range(table.rows)], pa.binary()
        )
    pq.write_table(pa.table(columns), folder / "run.parquet")
    if table.events:
        pq.write_table(pa.Table.from_pylist(table.events), folder / "events.parquet")


def column(pa: Any, values: "np.ndarray[Any, Any]") -> Any:
    """Return a column (k,), or a column of lists for (k, m)."""
    if values.ndim == 1:
        return pa.array(values)
    return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])


# --- A run as a LeRobot data set of one episode, in the layout of its version 2.1 -----------------
#
# `meta/info.json` tells the features; `episodes.jsonl`, `tasks.jsonl` and
# `episodes_stats.jsonl` beside it tell the episode. `data/chunk-000/episode_000000.parquet` has
# a row for each frame, and `videos/chunk-000/observation.images.CAMERA/episode_000000.mp4` as
# many pictures. State is the measured joints, the tool's pose and its wrench; action the joints
# that were commanded.
VERSION: Final = "v2.1"
_POSE: Final = ("x", "y", "z", "roll", "pitch", "yaw")
_WRENCH: Final = ("fx", "fy", "fz", "mx", "my", "mz")
DATA: Final = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
VIDEO: Final = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
_FIRST: Final = {"episode_chunk": 0, "episode_index": 0}


def write_lerobot(table: TickTable, folder: Path, fps: int, task: str) -> None:
    """Write a data set of `fps` frames a second. Raises `OSError`, `ConfigError`."""
    pa, pq = arrow()
    period_s = table.cell.config.timing.period_s
    every = round(1.0 / (fps * period_s))
    if every < 1 or abs(every * fps * period_s - 1.0) > 1e-9:
        raise ConfigError(f"--fps {fps}: the tick's {1.0 / period_s:g} Hz are no multiple of it")
    rows = np.arange(0, table.rows, every)
    state, action, features = _features(table, rows)
    count = len(rows)
    columns: dict[str, Any] = {
        "observation.state": state,
        "action": action,
        "timestamp": (np.arange(count) / fps).astype(np.float32),
        "frame_index": np.arange(count),
        "episode_index": np.zeros(count, dtype=np.int64),
        "index": np.arange(count),
        "task_index": np.zeros(count, dtype=np.int64),
    }
    for name in ("timestamp", "frame_index", "episode_index", "index", "task_index"):
        kind = "float32" if name == "timestamp" else "int64"
        features[name] = {"dtype": kind, "shape": [1], "names": None}
    data = folder / DATA.format(**_FIRST)
    data.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table({n: column(pa, v) for n, v in columns.items()}), data)
    cameras = [
        camera for camera in sorted(table.pictures) if table.pictures[camera][0][0] < rows[-1]
    ]
    for camera in cameras:
        key = f"observation.images.{camera}"
        path = folder / VIDEO.format(video_key=key, **_FIRST)
        features[key] = _video(path, table.pictures[camera], rows, fps)
    info = {
        "codebase_version": VERSION,
        "robot_type": table.cell.config.name,
        "total_episodes": 1,
        "total_frames": count,
        "total_tasks": 1,
        "total_videos": len(cameras),
        "total_chunks": 1,
        "chunks_size": 1000,
        "fps": fps,
        "splits": {"train": "0:1"},
        "data_path": DATA,
        "video_path": VIDEO if cameras else None,
        "features": features,
    }
    meta = folder / "meta"
    meta.mkdir(exist_ok=True)
    (meta / "info.json").write_text(json.dumps(info, indent=4), encoding="utf-8")
    stats = {name: _statistics(values) for name, values in columns.items()}
    lines = {
        "tasks": {"task_index": 0, "task": task},
        "episodes": {"episode_index": 0, "tasks": [task], "length": count},
        "episodes_stats": {"episode_index": 0, "stats": stats},
    }
    for name, line in lines.items():
        (meta / f"{name}.jsonl").write_text(json.dumps(line) + "\n", encoding="utf-8")


def _features(table: TickTable, rows: Any) -> tuple[Array, Array, dict[str, Any]]:
    """Return state, action and what their values are; a wrench that was not there is 0."""
    columns, joints = table.columns, table.cell.joints
    places = [f"{joint}.pos" for joint in joints]
    parts, names = [columns["state.q"]], list(places)
    for part in table.cell.parts:
        of = part.prefix
        parts += [columns[f"state.{of}pose_mrf"], columns[f"state.{of}wrench_mrf"]]
        names += [f"{of}{axis}" for axis in (*_POSE, *_WRENCH)]
    state = np.nan_to_num(np.concatenate(parts, axis=1)[rows]).astype(np.float32)
    action = columns["action.q"][rows].astype(np.float32)
    features = {
        name: {"dtype": "float32", "shape": [len(of)], "names": of}
        for name, of in (("observation.state", names), ("action", places))
    }
    return state, action, features


def _statistics(values: Array) -> dict[str, list[float]]:
    table = values.reshape(len(values), -1).astype(float)
    found = {name: getattr(table, name)(axis=0).tolist() for name in ("min", "max", "mean", "std")}
    return {**found, "count": [len(values)]}


def _video(path: Path, pictures: list[tuple[int, bytes]], rows: Any, fps: int) -> dict[str, Any]:
    """Write the newest picture at each frame as a video; return the feature's description."""
    try:
        import av
    except ImportError:
        raise ConfigError(
            "pictures of a LeRobot data set need PyAV: pip install 'telerobot[export]'"
        ) from None
    path.parent.mkdir(parents=True, exist_ok=True)
    newest, frame = 0, _decoded(av, pictures[0][1])
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=fps)
        stream.width, stream.height, stream.pix_fmt = frame.width, frame.height, "yuv420p"
        for i, row in enumerate(rows.tolist()):
            while newest + 1 < len(pictures) and pictures[newest + 1][0] <= row:
                newest += 1
                frame = _decoded(av, pictures[newest][1])
            shown = frame.reformat(format="yuv420p")
            shown.pts, shown.time_base = i, Fraction(1, fps)
            container.mux(stream.encode(shown))
        container.mux(stream.encode())
    return {
        "dtype": "video",
        "shape": [frame.height, frame.width, 3],
        "names": ["height", "width", "channels"],
        "info": {
            "video.fps": fps,
            "video.height": frame.height,
            "video.width": frame.width,
            "video.channels": 3,
            "video.codec": "mpeg4",
            "video.pix_fmt": "yuv420p",
            "video.is_depth_map": False,
            "has_audio": False,
        },
    }


def _decoded(av: Any, png: bytes) -> Any:
    with av.open(io.BytesIO(png)) as container:
        return next(container.decode(video=0))


# --- `telerobot export RUN.mcap --to numpy|parquet|lerobot`: a recorded run as tables -------------
def run(args: argparse.Namespace) -> int:
    """Export a run. Raises `ConfigError` for a package that is missing, `OSError`."""
    out = args.out or args.file.with_suffix(f".{args.to}")
    table = table_of(args.file, read_cell(args.file))
    if args.to == "numpy":
        write_numpy(table, out)
    elif args.to == "parquet":
        write_parquet(table, out)
    else:
        write_lerobot(table, out, max(1, args.fps), args.task)
    pictures = sum(map(len, table.pictures.values()))
    print(f"{out}: {table.rows} ticks, {len(table.events)} events, {pictures} pictures")
    return 0
