"""Results of many runs as one table: printed, and as Markdown."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from .controllers.contract import CLEARANCE
from .run import PeerResult

KEPT = CLEARANCE - 1e-3
"""A run kept what it was told to whose least clearance is greater: a barrier is linear in each
period, and gives way by some tenths of a millimetre [m]."""

LEGEND = (
    "Least clearance: true distance between the arm's shapes and things, between ticks too; all "
    "are told to keep 20 mm.",
    "Kept: targets reached in runs whose least clearance is above 19 mm. Others had to leave what "
    "is reached only by going nearer.",
    "Collisions: distances that fell below zero; in brackets those that the arm's own motion "
    "closed, the others ran into an arm.",
    "Off path: mean distance of the tool from the straight line to its target.",
    "Stuck: not reached, and at rest or creeping in the end. No command: periods in which a "
    "controller found none, and stood.",
    "A, J: greatest joint acceleration and jerk over the drive's bounds: telerobot keeps both, "
    "'pink, A' the first.",
)

COLUMNS = (
    "scenes", "controller", "runs", "targets reached", "kept", "stuck", "collisions (own)",
    "least clearance [mm]", "off path [mm]", "no command", "A [1]", "J [1]", "tick p50 / p99 [µs]",
)  # fmt: skip


class ReportRow(NamedTuple):
    """A line of the table."""

    scenes: str
    controller: str
    cells: tuple[str, ...]


def as_json(result: PeerResult) -> dict[str, Any]:
    """Return a result as plain values, tick times as percentiles [µs]."""
    times = np.array(result.tick_us)
    return asdict(result) | {
        "tick_us": {
            "p50": round(float(np.percentile(times, 50)), 1),
            "p99": round(float(np.percentile(times, 99)), 1),
            "max": round(float(times.max()), 1),
        }
    }


def rows(results: Sequence[dict[str, Any]]) -> Iterator[ReportRow]:
    """Yield the lines: scenes by label and motion, every controller in each."""
    names = list(dict.fromkeys(result["controller"] for result in results))
    for feasible in (True, False):
        for moving in (False, True):
            scenes = f"{'feasible' if feasible else 'not shown feasible'}, " + (
                "moving" if moving else "standing"
            )
            for name in names:
                part = [
                    r
                    for r in results
                    if (r["feasible"], r["moving"], r["controller"]) == (feasible, moving, name)
                ]
                if part:
                    yield ReportRow(scenes, name, _cells(part))


def markdown(results: Sequence[dict[str, Any]]) -> str:
    """Return the table and its legend as Markdown."""
    lines = ["| " + " | ".join(COLUMNS) + " |", "|" + " --- |" * len(COLUMNS)]
    lines += [
        "| " + " | ".join((row.scenes, row.controller, *row.cells)) + " |" for row in rows(results)
    ]
    return "\n".join([*lines, "", *(f"- {line}" for line in LEGEND), ""])


def text(results: Sequence[dict[str, Any]]) -> str:
    """Return the table in columns for a terminal."""
    table = [COLUMNS, *((row.scenes, row.controller, *row.cells) for row in rows(results))]
    widths = [max(len(line[i]) for line in table) for i in range(len(COLUMNS))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in table
    )


def _cells(part: list[dict[str, Any]]) -> tuple[str, ...]:
    def total(key: str) -> int:
        return sum(result[key] for result in part)

    least = 1e3 * min(result["clearance_m"] for result in part)
    off = 1e3 * float(np.mean([result["off_path_m"] for result in part]))
    p50, p99 = (np.median([result["tick_us"][p] for result in part]) for p in ("p50", "p99"))
    return (
        str(len(part)),
        f"{total('reached')} of {total('targets')}",
        str(sum(result["reached"] for result in part if result["clearance_m"] > KEPT)),
        str(total("stuck")),
        f"{total('collisions')} ({total('own_collisions')})",
        f"{least:.1f}",
        f"{off:.1f}",
        str(total("no_command")),
        f"{max(result['acceleration'] for result in part):.2f}",
        f"{max(result['jerk'] for result in part):.2f}",
        f"{p50:.0f} / {p99:.0f}",
    )
