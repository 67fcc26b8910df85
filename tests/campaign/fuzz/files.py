"""Fuzzes cell files and URDFs: each loads and can be checked, or is refused in one line."""

import random
import re
import tempfile
from pathlib import Path

from telerobot.config.load import HERE, ConfigError, load_cell, shipped
from telerobot.drivers.device import DeviceError
from telerobot.tools.checks.findings import failed
from telerobot.tools.checks.judge import judge
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from .blind import Blind
from .outcome import Outcome

FILES = 30
"""Files of one job [1]."""
PLAYED_EVERY = 6
"""Of the files that `check` finds no error in, every so many is simulated [1]."""
NUMBERS = (
    "0", "-1", "1e-5", "5e-324", "1e300", "-1e300", "nan", "inf", "0.5", "2", "1000000000000",
    "true", '"x"', "[]", "[1.0, 2.0]", "{}", "9" * 5000, "0x7fffffffffffffff",
)  # fmt: skip
_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?(?![\w.])")


def play(seed: int) -> Outcome:
    """Spoil files, load them, judge what loads, and run some of what is judged to be well."""
    outcome, dice = Outcome("files", seed), random.Random(f"files {seed}")
    well = 0
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(FILES):
            path, what = _spoilt(Path(folder), dice)
            outcome.inputs["files"] += 1
            try:
                cell = load_cell(path)
                findings = judge(cell)
                if failed(findings):
                    continue
                well += 1
                if well % PLAYED_EVERY == 0:
                    outcome.inputs["cells simulated"] += 1
                    Simulation(cell, Script(duration_s=0.2), cameras=Blind).run()
            except ConfigError as refusal:
                lines = str(refusal).splitlines()
                if not all(line.startswith(folder) and len(line) <= 1000 for line in lines):
                    outcome.reasons.append(f"{what}: not a line each: {str(refusal)[:100]!r}")
            except DeviceError:
                outcome.inputs["devices refused"] += 1
            except Exception as error:  # noqa: BLE001  that nothing else is raised is what is tried
                outcome.reasons.append(outcome.raised(error, what))
    return outcome


def _spoilt(folder: Path, dice: random.Random) -> tuple[Path, str]:
    """Write a cell with mistakes in it or in its URDF; return it, and what they are."""
    name = dice.choice(shipped("cells"))
    text = _flattened(name)
    robots = [robot for robot in shipped("robots") if f'urdf = "{robot}"' in text]
    path, told = folder / "cell.toml", [name]
    if robots and dice.random() < 0.5:
        urdf = (HERE / "robots" / f"{robots[0]}.urdf").read_text(encoding="utf-8")
        for _ in range(dice.randint(1, 2)):
            urdf, what = _mistake(urdf, dice)
            told.append(what)
        (folder / "robot.urdf").write_text(urdf, encoding="utf-8")
        text = text.replace(f'urdf = "{robots[0]}"', 'urdf = "robot.urdf"')
    else:
        for _ in range(dice.randint(1, 3)):
            text, what = _mistake(text, dice)
            told.append(what)
    path.write_text(text, encoding="utf-8")
    return path, ", ".join(told)


def _flattened(name: str) -> str:
    """Return a shipped cell's text; one that extends another goes on doing so."""
    return (HERE / "cells" / f"{name}.toml").read_text(encoding="utf-8")


def _mistake(text: str, dice: random.Random) -> tuple[str, str]:
    """Return a text with one mistake, and a word on it."""
    way, lines = dice.random(), text.splitlines()
    at = dice.randrange(len(lines) + 1)
    numbers = list(_NUMBER.finditer(text))
    if way < 0.6 and numbers:
        found, number = dice.choice(numbers), dice.choice(NUMBERS)
        return (
            text[: found.start()] + number + text[found.end() :],
            f"{found.group()} -> {number[:12]} in line {text[: found.start()].count(chr(10)) + 1}",
        )
    if way < 0.75:
        return "\n".join(lines[:at] + lines[at + 1 :]), f"without line {at + 1}"
    if way < 0.85:
        return "\n".join(lines[: at + 1] + lines[at:]), f"line {at + 1} twice"
    cut = dice.randrange(len(text) + 1)
    if way < 0.95:
        odd = dice.choice(("\x00", "ü", "[", '"', "<", "=", "\n", "9"))
        return text[:cut] + odd + text[cut:], f"{odd!r} at {cut}"
    return text[:cut], f"cut at {cut}"
