"""`telerobot soak CELL`: hostile operators against a cell, in virtual time, from seeds.

They hold every lever at once, ask for what cannot be, change gains and frames while the arm moves,
fall silent and come back, and sensors fail beside them. No bound may be broken on the bus, and no
fault may come but by what the arm ran into. The cell is taken as its file says it is.
"""

import argparse
from dataclasses import dataclass
from functools import partial

from pydantic import TypeAdapter

from ...config.errors import ConfigError
from ...config.load import load_cell
from ..host import jobs
from ..simulation.simulation import Simulation
from .hostile import script
from .sights import ComputedSights
from .touches import Touches


@dataclass(frozen=True)
class Soaked:
    """The run of one seed; plain values."""

    seed: int
    ticks: int
    reasons: list[str]
    """Broken promises."""
    most_n: float
    """Greatest force on what stands around, or between parts of the arm [N]."""
    command_hash: str


_ROWS = TypeAdapter(Soaked)


def run(args: argparse.Namespace) -> int:
    """Play every seed; return 0 if all promises were kept, 130 if interrupted."""
    cell = load_cell(args.cell)
    if len(cell.parts) > 1:
        raise ConfigError(f"{cell.path}: mechanisms: {len(cell.parts)} tables: soak leads one arm")
    finished = jobs.run_all(
        partial(soaked, str(args.cell)),
        args.seeds,
        jobs.place_of(args),
        "soak",
        lambda run: f"seed {run.seed}: {'; '.join(run.reasons) or 'well'}"[:200],
        lambda _, run: _ROWS.dump_python(run),
        lambda _, kept: _ROWS.validate_python(kept),
        lambda seed: f"{args.cell}, {seed}",
    )
    failed = [run for run in finished.results if run.reasons]
    hit = sum(run.most_n > 0.0 for run in finished.results)
    print(
        f"{len(finished.results)} runs, {sum(run.ticks for run in finished.results)} ticks, "
        f"{hit} ran into something: {len(failed)} broke a promise"
    )
    for run in failed:
        print(f"telerobot soak {args.cell} --seeds {run.seed}  # {run.reasons[0]}")
    if finished.interrupted:
        return 130
    return 1 if failed else 0


def soaked(name: str, seed: int) -> Soaked:
    """Play the hostile operators of a seed against a cell. Raises `ConfigError`."""
    cell = load_cell(name)
    simulation = Simulation(cell, script(cell, seed), cameras=lambda s: ComputedSights(s, seed))
    touches = Touches(simulation)
    summary = simulation.run().summary
    reasons = touches.unexplained()
    if summary["failure"] is not None:
        reasons.append(f"not played: {summary['failure']}")
    reasons += [
        f"{v.joint} {v.kind} {v.value:.6g} over {v.bound:.6g} at {v.time_s:.3f} s"
        for v in simulation.observer.violations[:5]
    ]
    return Soaked(
        seed, len(simulation.states), reasons, touches.most_n, str(summary["command_hash"])
    )
