"""Which changes of the code that safety rests on do the tests of the same room not notice?

    python tests/mutants/run.py [MODULE...] [--only TEXT] [--jobs 2]

Each module's mutants (`mutations.py`) run in a process of its own (`session.py`). Those that live
on are to stand in `survivors.toml`, each with its reason; one listed there that is killed, or that
there is no more, is an error. Exit status 1 where fewer than 95 % of a module's mutants are killed,
or where the list is wrong. A module, a test or a list's heading that is not there is an error.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tomllib
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from tqdm import tqdm

HERE: Final = Path(__file__).resolve().parent
ROOT: Final = HERE.parents[1]
SURVIVORS: Final = HERE / "survivors.toml"
WANTED: Final = 0.95
"""Part of a module's mutants that its room's tests kill."""

CONTROL, DESK = "tests/server/control", "tests/server/operators"
STOP = f"{CONTROL}/stop"
TARGETS: Final[dict[str, tuple[str, ...]]] = {
    "server.control.stop.limiter": (
        f"{STOP}/test_gate.py",
        f"{STOP}/test_limiter.py",
    ),
    "server.control.stop.profile": (
        f"{STOP}/test_proportion.py",
        f"{STOP}/test_quick_stop.py",
        f"{STOP}/test_trajectory.py",
        f"{STOP}/test_velocity_profile.py",
    ),
    "server.control.stop.trajectory": (
        f"{STOP}/test_trajectory.py",
        f"{STOP}/test_proportion.py",
        f"{STOP}/test_velocity_profile.py",
    ),
    "server.control.spatial": (
        f"{CONTROL}/test_spatial.py",
        f"{CONTROL}/test_rigid_body.py",
        STOP,
    ),
    "server.control.barriers.programme": (f"{CONTROL}/barriers/test_programme.py",),
    "server.control.actuation.believed": (f"{CONTROL}/actuation/test_believed.py",),
    "server.control.joint_task.load_shares": (f"{CONTROL}/joint_task/test_load_shares.py",),
    "server.operators.admission": (
        f"{DESK}/test_admission.py",
        f"{DESK}/test_lease.py",
    ),
    "server.mode": ("tests/server/test_mode.py",),
    "protocols.proof": ("tests/protocols/test_proof.py",),
    "protocols.codec": ("tests/protocols/test_codec.py",),
}
"""Modules, and the tests of their rooms."""
QUICK: Final = "not slow and not hil and not browser"
"""Marks of tests that take part."""


@dataclass
class Verdict:
    """What was found out about a module's mutants."""

    module: str
    mutants: int = 0
    killed: int = 0
    cpu_s: float = 0.0
    alive: list[str] = field(default_factory=list)
    """Names of those that live on."""
    names: set[str] = field(default_factory=set)
    """Names of all that were tried."""
    errors: list[str] = field(default_factory=list)
    whole: bool = False

    def take(self, row: dict[str, Any]) -> None:
        """Take in one line of a session."""
        if "error" in row:
            self.errors.append(row["error"])
        self.mutants = row.get("mutants", self.mutants)
        self.cpu_s = row.get("cpu_s", self.cpu_s)
        if "killed" in row:
            name = f"{row['scope'] or 'module'}: {row['change']}"
            self.names.add(name)
            self.killed += row["killed"]
            if not row["killed"]:
                self.alive.append(name)

    def wrong(self, listed: dict[str, str], whole: bool) -> list[str]:
        """Return what is not as it is to be; of the list only where the `whole` was tried."""
        found = list(self.errors)
        found += [f"lives on, without a reason: {n}" for n in self.alive if not listed.get(n)]
        for name in listed:
            if name in self.names and name not in self.alive:
                found.append(f"is killed, and listed: {name}")
            elif name not in self.names and whole and self.whole:
                found.append(f"is listed, and there is none: {name}")
        if whole and self.whole and self.killed < WANTED * self.mutants:
            found.append(f"{self.killed} of {self.mutants} are killed, less than {WANTED:.0%}")
        return [f"{self.module}: {each}" for each in found]


class Sessions:
    """The processes that try mutants, at most so many at a time."""

    def __init__(self, only: str, bar: "tqdm[Any]") -> None:
        self._only, self._bar = only, bar
        self._running: list[subprocess.Popen[str]] = []
        self._over = False

    def judge(self, verdict: Verdict, tests: tuple[str, ...]) -> None:
        """Try the mutants of one module."""
        if self._over:
            return
        with subprocess.Popen(
            [sys.executable, str(HERE / "session.py"), f"telerobot.{verdict.module}", self._only,
             "-m", QUICK, *tests],
            stdout=subprocess.PIPE, text=True, cwd=ROOT, start_new_session=True,
        ) as process:  # fmt: skip
            self._running.append(process)
            assert process.stdout is not None
            for line in process.stdout:
                row = json.loads(line)
                verdict.take(row)
                if "mutants" in row:
                    self._bar.total += row["mutants"]
                self._bar.update("killed" in row)
        if process.returncode and not self._over:
            verdict.errors.append(f"its session ended with {process.returncode}")
        verdict.whole = not self._over and not verdict.errors

    def end(self) -> None:
        """End those that run; what they found is kept."""
        self._over = True
        for process in self._running:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)


def lost(survivors: Iterable[str]) -> list[str]:
    """Return what the programme and the list of `survivors` name, and is not there."""
    found = [f"{m}: no such module" for m in TARGETS if not _file_of(m).is_file()]
    for module, tests in TARGETS.items():
        found += [f"{module}: no tests {t}" for t in tests if not (ROOT / t).exists()]
    unknown = sorted({*survivors} - {*TARGETS})
    return found + [f"{m}: is in {SURVIVORS.name}, and is no module here" for m in unknown]


def _file_of(module: str) -> Path:
    return ROOT / f"{module.replace('.', '/')}.py"


def table(verdicts: list[Verdict], survivors: dict[str, dict[str, str]]) -> str:
    """Return what was found, a line for each module."""
    lines = [f"{'module':42} mutants  killed  listed      %   CPU s"]
    for v in verdicts:
        if not v.names:
            continue
        listed = len(survivors.get(v.module, {}))
        lines.append(
            f"{v.module:42} {len(v.names):7} {v.killed:7} {listed:7} "
            f"{100 * v.killed / len(v.names):6.1f} {v.cpu_s:7.1f}"
            + ("" if v.whole else f"   of {v.mutants}")
        )
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else "")
    parser.add_argument("modules", nargs="*", metavar="MODULE", help="part of a name; all if none")
    parser.add_argument("--only", default="", metavar="TEXT", help="mutants that say so")
    parser.add_argument("--jobs", type=int, choices=(1, 2), default=2)
    asked = parser.parse_args()
    chosen = {
        name: tests for name, tests in TARGETS.items()
        if not asked.modules or any(part in name for part in asked.modules)
    }  # fmt: skip
    if not chosen:
        parser.error(f"none of {', '.join(TARGETS)}")
    survivors: dict[str, dict[str, str]] = tomllib.loads(SURVIVORS.read_text())
    verdicts = [Verdict(name) for name in chosen]
    interrupted = False
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with tqdm(total=0, unit="mutant", disable=None) as bar:
        sessions = Sessions(asked.only, bar)
        with ThreadPoolExecutor(asked.jobs) as pool:
            try:
                work = [pool.submit(sessions.judge, v, chosen[v.module]) for v in verdicts]
                for each in work:
                    each.result()
            except KeyboardInterrupt:
                interrupted = True
                sessions.end()
    wrong = [w for v in verdicts for w in v.wrong(survivors.get(v.module, {}), not asked.only)]
    wrong += [f"{v.module}: no mutants" for v in verdicts if v.whole and not v.mutants]
    wrong += lost(survivors)
    print(table(verdicts, survivors), *wrong, sep="\n")
    if interrupted:
        print("interrupted")
        return 130
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
