"""This revision and another one, measured in turn on one machine: what a clock says is a ratio.

Each measures itself, by its own `make bench`, in a process of its own: so a bench that one of them
does not have, or whose figures have other names, is left out. Who goes first changes every round.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any, Final

from telerobot.drivers.device import DeviceError
from telerobot.tools.bench.figures import Figures, machine

ROUNDS: Final = 3
"""Times that each of them is measured [1]."""
HERE: Final = Path(__file__).resolve().parents[2]

Leaves = dict[tuple[str, ...], float]
"""Figures by bench, cell, name and, where it is a table, its row."""


def compare(revision: str, only: Sequence[str], quick: bool) -> Figures:
    """Measure both, print each figure of theirs as it was and is, and return all.

    Raises `DeviceError` for a revision that there is not, or that cannot be measured.
    """
    told: list[Figures] = [machine()]
    print(f"load {told[0]['load_1min']} on {told[0]['cores']} cores: {told[0]['processor']}")
    with tempfile.TemporaryDirectory() as folder, checked_out(HERE, revision) as before:
        trees = {"before": before, "now": HERE}
        found: dict[str, list[Leaves]] = {name: [] for name in trees}
        for tree in trees.values():
            _run(tree, ["-c", "import telerobot.server.daemon, telerobot.drivers.rig.rig"])
        for i in range(ROUNDS):
            for name in sorted(trees, reverse=bool(i % 2)):
                print(f"round {i + 1} of {ROUNDS}: {name}", flush=True)
                file = Path(folder) / "bench.json"
                _measure(trees[name], [*only], quick, file)
                found[name].append(leaves(json.loads(file.read_text())))
            told.append(machine())
    rows = list(compared(found["before"], found["now"]))
    for where, was, now, ratios in rows:
        spread = f"{min(ratios):.2f} to {max(ratios):.2f}"
        print(f"{' '.join(where):52} {was:10.1f} → {now:10.1f}   × {now / was:.2f} ({spread})")
    return {
        "before": revision,
        "rounds": ROUNDS,
        "machine": told[0],
        "loads": [each["load_1min"] for each in told],
        "figures": [
            {"figure": " ".join(where), "before": was, "now": now, "ratios": ratios}
            for where, was, now, ratios in rows
        ],
    }


@contextmanager
def checked_out(repository: Path, revision: str) -> Iterator[Path]:
    """Yield a folder with a revision of a repository in it, which is gone afterwards.

    Raises `DeviceError` where it cannot be had.
    """
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "before"
        git = ["git", "-C", str(repository), "worktree"]
        added = subprocess.run(
            [*git, "add", "--quiet", "--detach", str(tree), revision],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        if added.returncode:
            raise DeviceError(f"--against {revision}: {' '.join(added.stderr.split())}")
        page = Path("tools/operator/web/static/vendor")  # what is fetched is in no revision
        if (repository / page).is_dir():
            shutil.copytree(repository / page, tree / page, dirs_exist_ok=True)
        try:
            yield tree
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True)


def _measure(tree: Path, only: list[str], quick: bool, file: Path) -> None:
    laboratory = (tree / "tests" / "bench" / "__main__.py").is_file()
    command = ["-m", "laboratory.bench"] if laboratory else ["-m", "telerobot", "bench"]
    _run(tree, [*command, "--only", *only, "--json", str(file), *(["--quick"] if quick else [])])


def _run(tree: Path, arguments: list[str]) -> None:
    environment = {**os.environ, "PYTHONPATH": str(tree / ".namespace")}
    done = subprocess.run(
        [sys.executable, *arguments], cwd=tree, env=environment,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        last = (done.stderr.strip() or "it told nothing").splitlines()[-1]
        raise DeviceError(f"{tree.name}: {' '.join(arguments[:2])} ended with {last}")


def leaves(of: Mapping[str, Any], where: tuple[str, ...] = ()) -> Leaves:
    """Return the numbers of a bench's JSON, each with the keys that lead to it."""
    found: Leaves = {}
    for key, value in of.items():
        if isinstance(value, Mapping) and key != "machine":
            found |= leaves(value, (*where, key))
        elif isinstance(value, (int, float)) and not isinstance(value, bool) and where:
            found[*where, key] = float(value)
    return found


def compared(
    before: Sequence[Leaves], now: Sequence[Leaves]
) -> Iterator[tuple[tuple[str, ...], float, float, list[float]]]:
    """Yield each figure that all rounds have: its medians, and the ratio in each round.

    A figure that was zero in a round has no ratio; one that is the same in all is no measurement.
    """
    for where in before[0]:
        if not all(where in each for each in (*before, *now)):
            continue
        pairs = [(was[where], new[where]) for was, new in zip(before, now, strict=True)]
        if len({value for pair in pairs for value in pair}) > 1 and all(was for was, _ in pairs):
            was, new = median(a for a, _ in pairs), median(b for _, b in pairs)
            yield where, was, new, [b / a for a, b in pairs]
