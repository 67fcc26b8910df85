"""Arguments of the commands, as `cli.toml` describes them: `--help` needs no command's module."""

import argparse
import math
import os
import tomllib
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Final

DESCRIBED: Final[dict[str, Any]] = tomllib.loads(
    Path(__file__).with_name("cli.toml").read_text(encoding="utf-8")
)


def add(parser: argparse.ArgumentParser, arguments: Mapping[str, Mapping[str, Any]]) -> None:
    """Add arguments of `cli.toml` to a parser."""
    groups: dict[str, Any] = {}
    for name, told in arguments.items():
        how, into = dict(told), parser
        if "alone" in how:
            group = how.pop("alone")
            if group not in groups:
                groups[group] = parser.add_mutually_exclusive_group()
            into = groups[group]
        if "type" in how:
            how["type"] = _TYPES[how["type"]]
        if "within" in how:
            least, most, unit = how.pop("within")
            how["type"] = _within(least, most, unit, how["type"])
        if "judge" in how:
            how["type"] = _judged_by(how.pop("judge"))
        if "default_of" in how:
            how["default"] = _DEFAULTS[how.pop("default_of")]()
        into.add_argument(name, **how)


def jobs(parser: argparse.ArgumentParser, processes: int, rows: Path) -> None:
    """Add where jobs run; `processes` and `rows` by default."""
    add(parser, DESCRIBED["shared"]["jobs"])
    parser.set_defaults(jobs=processes, rows=rows)


def completion(parser: argparse.ArgumentParser) -> None:
    """`telerobot completion`."""
    import shtab

    parser.add_argument("shell", metavar="SHELL", choices=shtab.SUPPORTED_SHELLS, help="bash, zsh…")


def bench(
    parser: argparse.ArgumentParser,
    benches: Iterable[str] = ("tick", "simulate", "sync", "latency"),
) -> None:
    """`telerobot bench`."""
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures as JSON")
    parser.add_argument("--quick", action="store_true", help="fewer samples, within a minute")
    parser.add_argument(
        "--only", nargs="+", choices=(*benches,), metavar="NAME",
        default=(*benches,), help=f"of {', '.join(benches)}",
    )  # fmt: skip


def duration(text: str) -> float:
    """Return a duration from the command line [s]; it is positive and finite."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0.0 < seconds < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds above 0")
    return seconds


def _within(least: float, most: float, unit: str, kind: type) -> Callable[[str], Any]:
    """Return what reads a number of a `kind` from the command line, `least` to `most`."""

    def read(text: str) -> Any:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not least <= value <= most:
            words = f"{text!r}: must be from {least:.7g} to {most:.7g} {unit}"
            raise argparse.ArgumentTypeError(words)
        return value

    return read


def _judged_by(judge: str) -> Callable[[str], object]:
    """Return a judge of an argument, MODULE:FUNCTION of the tools, imported when there is one."""
    module, _, function = judge.partition(":")

    def judge_of(text: str) -> object:
        judged: object = getattr(import_module(f"{__package__}.{module}"), function)(text)
        return judged

    return judge_of


def _state_folder() -> Path:
    """Return the folder of black boxes: a unit's of systemd, else the user's own."""
    given = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    if given:
        return Path(given)
    own = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local/state")
    return Path(own) / "telerobot"


_TYPES: Final[Mapping[str, Callable[[str], Any]]] = {
    "path": Path, "int": int, "float": float, "duration": duration,
}  # fmt: skip
_DEFAULTS: Final[Mapping[str, Callable[[], Any]]] = {
    "state folder": _state_folder,
    "user": lambda: os.environ.get("USER") or "operator",
}
