"""A recorded run as a table with one row for each tick: state, action, wrench, events, pictures.

State is what was measured, action what the daemon did with what was asked: the commanded joints,
and each source's twist. All of it is computed again from the recorded inputs (`replay`), so that a
row holds what one tick knew, and nothing of another one.
"""

import bisect
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from ....config.load import Cell
from ....server.control.spatial import Array
from ...host.progress import counted
from ..live.viewer import picture_in
from ..replay.replay import Replay, Replayed
from ..run_file import RecordError, read_run

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
        """Number of ticks."""
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
        row[f"state.{of}wrench_mrf"] = six if output.wrench_mrf is None else output.wrench_mrf
        sensor = inputs.wrench_sensor
        row[f"state.{of}wrench_sensor"] = six if sensor is None else sensor
        row[f"action.{of}twist"] = output.twist
        row[f"action.{of}granted"] = np.float64(output.scale)
        for source, twist in output.twists.items():
            row[f"action.{of}sources.{source}"] = twist
    return {name: np.asarray(value) for name, value in row.items()}
