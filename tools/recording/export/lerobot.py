"""A run as a LeRobot data set of one episode, in the layout of its version 2.1.

`meta/info.json` tells the features; `episodes.jsonl`, `tasks.jsonl` and `episodes_stats.jsonl`
beside it tell the episode. `data/chunk-000/episode_000000.parquet` has a row for each frame, and
`videos/chunk-000/observation.images.CAMERA/episode_000000.mp4` as many pictures. State is the
measured joints, the tool's pose and its wrench; action the joints that were commanded.
"""

import io
import json
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np

from ....config.load import ConfigError
from ....server.control.spatial import Array
from .parquet import arrow, column
from .table import TickTable

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
    parts, names = [columns["state.q"]], [f"{joint}.pos" for joint in joints]
    for part in table.cell.parts:
        of = part.prefix
        parts += [columns[f"state.{of}pose_mrf"], columns[f"state.{of}wrench_mrf"]]
        names += [f"{of}{axis}" for axis in (*_POSE, *_WRENCH)]
    state = np.nan_to_num(np.concatenate(parts, axis=1)[rows]).astype(np.float32)
    action = columns["action.q"][rows].astype(np.float32)
    features = {
        "observation.state": {"dtype": "float32", "shape": [len(names)], "names": names},
        "action": {
            "dtype": "float32",
            "shape": [len(joints)],
            "names": [f"{joint}.pos" for joint in joints],
        },
    }
    return state, action, features


def _statistics(values: Array) -> dict[str, list[float]]:
    table = values.reshape(len(values), -1).astype(float)
    found = {
        "min": table.min(axis=0),
        "max": table.max(axis=0),
        "mean": table.mean(axis=0),
        "std": table.std(axis=0),
    }
    return {**{name: value.tolist() for name, value in found.items()}, "count": [len(values)]}


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
