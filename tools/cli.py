"""The command line: `telerobot COMMAND …`; every command is a module of its own.

A command's module offers `run(args) -> int` and is imported only when it runs. Its arguments stand
in `cli.toml`, and what these cannot say in `arguments.py`.
Exit codes: 0 well, 1 the thing failed, 2 bad usage or bad config, 130 interrupted.
"""

import argparse
import gc
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from importlib.metadata import version
from typing import Any, Final, NoReturn

from ..config.errors import ConfigError, printable
from . import arguments
from .host.first_start import told


@dataclass(frozen=True)
class HelpRow:
    """A row of the help: what is typed, which module does it, and how it is used."""

    name: str
    module: str
    summary: str
    examples: tuple[str, ...]
    arguments: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


def _rows() -> tuple[HelpRow, ...]:
    rows, shared = [], arguments.DESCRIBED["shared"]
    for name, row in arguments.DESCRIBED.items():
        if row is shared:
            continue
        takes = {key: how for group in row.get("takes", ()) for key, how in shared[group].items()}
        own = takes | row.get("arguments", {})
        rows.append(HelpRow(name, row["module"], row["summary"], tuple(row["examples"]), own))
    return tuple(rows)


COMMANDS: Final = _rows()


class Parser(argparse.ArgumentParser):
    """An argument parser whose complaint is one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {printable(message)} (see {self.prog} --help)\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code."""
    gc.set_threshold(50_000)  # what a start makes stays; looking through it takes an eighth of it
    typed = list(sys.argv[1:] if argv is None else argv)
    asked = next((a for a in typed if not a.startswith("-")), None)
    command = next((c for c in COMMANDS if c.name == asked), None)
    return guarded(str(asked), lambda: _run(command, typed))


def guarded(name: str, run: Callable[[], int]) -> int:
    """Run a command; tell in one line what went wrong, and return its exit code."""
    # Matrices of this size are slower on several threads; must stand before numpy is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        with told():
            return run()
    except ConfigError as error:
        return _fail(2, str(error))
    except OSError as error:
        if isinstance(error, BrokenPipeError):
            # The reader of our output has gone; keep the interpreter from complaining at exit.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1
        return _fail(1, " ".join(str(error).split()))
    except ImportError as error:
        return _fail(1, f"{name}: cannot be loaded: {error}")
    except KeyboardInterrupt:
        return 130
    except Exception as error:
        from ..drivers.device import DeviceError  # late: it may load what `--help` does without

        if not isinstance(error, DeviceError):
            raise
        return _fail(1, " ".join(str(error).split()))


def _run(command: HelpRow | None, typed: list[str]) -> int:
    args = build_parser((command,) if command else ()).parse_args(typed)
    run: Callable[[argparse.Namespace], int] | None = getattr(args, "run", None)
    if run is None:
        build_parser(()).print_help(sys.stderr)
        return 2
    code = run(args)
    sys.stdout.flush()
    return code


def build_parser(loaded: Sequence[HelpRow]) -> argparse.ArgumentParser:
    """Return the parser of all commands; only those that are `loaded` know their arguments."""
    parser = Parser(
        prog="telerobot",
        description="A control server for remote robot arms, its virtual hardware and its tools.",
        epilog="CELL is the path of a cell file or the name of a shipped one, such as pa10.\n"
        "`telerobot COMMAND --help` tells more. A first drive: telerobot demo",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"telerobot {version('telerobot')}")
    choices = parser.add_subparsers(metavar="COMMAND", dest="command", title="commands")
    for c in COMMANDS:
        sub = choices.add_parser(
            c.name,
            help=c.summary,
            description=c.summary[0].upper() + c.summary[1:] + ".",
            epilog="examples:\n" + "\n".join(f"  {e}" for e in c.examples),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if c in loaded:
            arguments.add(sub, c.arguments)
            own = getattr(arguments, c.name, None)
            if own is not None:
                own(sub)
            sub.set_defaults(run=partial(_imported, c))
    return parser


def _imported(command: HelpRow, args: argparse.Namespace) -> int:
    code: int = import_module(f"{__package__}.{command.module}").run(args)
    return code


def _fail(code: int, message: str) -> int:
    lines = [printable(line) for line in message.split("\n")]
    print("telerobot: " + "\n".join(lines), file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
