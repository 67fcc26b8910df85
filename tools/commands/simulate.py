"""`telerobot simulate CELL [SCRIPT]`: a run in virtual time, and its figures."""

import argparse
import json

from tqdm import tqdm

from ...config.errors import printable
from ..host.progress import SHOWN_AFTER_S
from ..scripts.script import Expected
from ..simulation.simulation import Simulation, simulate


def run(args: argparse.Namespace) -> int:
    """Simulate; return 1 if the script failed or missed what it expects, or a limit was violated.

    A cell with cameras has failed where no pictures can be made.
    """
    with tqdm(
        desc="simulated", unit="s", delay=SHOWN_AFTER_S, disable=None, leave=False,
        bar_format="{desc}: {n:.1f} of {total:.1f} s [{elapsed}<{remaining}]",
    ) as bar:  # fmt: skip

        def show(simulation: Simulation) -> None:
            player = simulation.player
            bar.total = player.start_s + player.script.duration_s
            bar.update(simulation.clock.time_s - bar.n)

        result = simulate(args.cell, args.script, args.record, show)
    if args.json:
        print(json.dumps(result.summary))
    else:
        print(_table(result.summary))
    return 0 if result.ok else 1


def _table(summary: dict[str, object]) -> str:
    """Return the summary for people, a line each."""
    lines = []
    for key, value in summary.items():
        if key == "events" and isinstance(value, list):
            lines.append("events")
            lines += [f"  {e['t_s']:8.2f} s  {e['name']:22} {e['detail']}" for e in value]
        elif key == "expected" and isinstance(value, list):
            lines.append("expected")
            rows = [Expected(**row) for row in value]
            lines += [f"  {'met' if row.met else 'MISSED':8}{row}" for row in rows]
        elif isinstance(value, list):
            shown = ", ".join(f"{v:.4f}" if isinstance(v, float) else str(v) for v in value)
            lines.append(f"{key:24} {shown or '-'}")
        elif isinstance(value, dict):
            lines.append(f"{key:24} " + ", ".join(f"{k} {v}" for k, v in value.items()))
        elif isinstance(value, float):
            lines.append(f"{key:24} {value:.5g}")
        else:
            lines.append(f"{key:24} {'-' if value is None else value}")
    return "\n".join(printable(line, 100_000) for line in lines)
