"""`telerobot completion SHELL`: the script that completes commands, options and cells."""

import argparse

import shtab

from ...config.load import shipped
from ..cli import COMMANDS, build_parser


def run(args: argparse.Namespace) -> int:
    """Print the shell's script for all commands; return 0."""
    parser = build_parser(COMMANDS)
    _offer_names(parser)
    print(shtab.complete(parser, args.shell))
    return 0


def _offer_names(parser: argparse.ArgumentParser) -> None:
    """Let arguments that name a shipped thing be completed by the names there are."""
    names = {"CELL": shipped("cells"), "SCRIPT": shipped("scripts")}
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for sub in action.choices.values():
                _offer_names(sub)
        elif isinstance(action.metavar, str) and action.metavar in names:
            # As choices they would also bound what may be given: for the shell's script only.
            action.choices = sorted(names[action.metavar])
