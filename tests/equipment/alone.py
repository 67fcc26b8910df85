"""Commands that are none of `telerobot`'s, by the same rules."""

import argparse
from collections.abc import Callable, Sequence

from telerobot.tools.cli import Parser, guarded


def run_alone(
    prog: str,
    add_arguments: Callable[[argparse.ArgumentParser], None],
    run: Callable[[argparse.Namespace], int],
    argv: Sequence[str] | None = None,
) -> int:
    """Run a command; return its exit code."""
    parser = Parser(prog=prog, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    args = parser.parse_args(argv)
    return guarded(prog, lambda: run(args))
