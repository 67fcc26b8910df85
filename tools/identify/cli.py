"""`telerobot identify CELL`: payload, sensor bias, mounting and cross-talk by a guided motion."""

import argparse
import json
import sys

from ...config.errors import printable
from ...config.load import Cell
from ..client.connection import OperatorError
from ..client.operator import Operator
from ..host.address import add_cell_arguments, cell_from
from .attitudes import AttitudeStop, attitudes
from .estimate import NotIdentified
from .guide import AttitudeMean
from .report import as_dict, snippet, table
from .run import identify, identify_simulated, judge
from .subject import Subject, subject_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    add_cell_arguments(parser, bus=False)
    parser.add_argument(
        "--mechanism", metavar="NAME", help="whose sensor, where the cell has several"
    )
    parser.add_argument(
        "--posture", default="ready", help="the wrist turns about this one (default: %(default)s)"
    )
    parser.add_argument(
        "--attitudes",
        type=_count,
        default=24,
        metavar="N",
        help="so many are measured, 6 to 200 (default: %(default)s)",
    )
    parser.add_argument(
        "--room",
        type=float,
        default=0.15,
        metavar="METRES",
        help="the tool stays within this distance of where the posture has it; nothing else keeps "
        "it from touching things (default: %(default)s)",
    )
    parser.add_argument(
        "--simulate", action="store_true", help="the cell's virtual hardware, in virtual time"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Identify; print what was found and the lines for the cell. Raises `ConfigError`."""
    cell = cell_from(args)
    subject = subject_of(cell, args.mechanism)
    part = subject.part
    stops = attitudes(part, args.posture, args.attitudes, args.room)
    try:
        lead = _simulated if args.simulate else _driven
        found = judge(part, lead(cell, stops, subject))
    except (NotIdentified, OperatorError) as error:
        print(f"telerobot: not identified: {printable(error)}", file=sys.stderr)
        return 1
    if args.json:
        print(json.dumps(as_dict(part, found)))
    else:
        print(f"{table(found)}\n\n{snippet(part, found)}")
    return 0


def _simulated(cell: Cell, stops: list[AttitudeStop], subject: Subject) -> list[AttitudeMean]:
    return identify_simulated(cell, stops, _say, subject)


def _driven(cell: Cell, stops: list[AttitudeStop], subject: Subject) -> list[AttitudeMean]:
    with Operator(cell, name="identify") as operator:
        operator.acquire()
        operator.enable()
        return identify(operator, stops, _say, subject)


def _count(text: str) -> int:
    count = int(text)
    if not 6 <= count <= 200:
        raise argparse.ArgumentTypeError(f"{count} is not within 6 to 200")
    return count


def _say(line: str) -> None:
    print(printable(line), file=sys.stderr, flush=True)
