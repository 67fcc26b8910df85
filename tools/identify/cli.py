"""`telerobot identify CELL`: payload, sensor bias, mounting and cross-talk by a guided motion."""

import argparse
import json
import sys

from ...config.errors import printable
from ...config.load import Cell
from ..client.connection import OperatorError
from ..client.operator import Operator
from ..host.address import cell_from
from .attitudes import AttitudeStop, attitudes
from .estimate import NotIdentified
from .guide import AttitudeMean
from .report import as_dict, snippet, table
from .run import identify, identify_simulated, judge
from .subject import Subject, subject_of


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


def _say(line: str) -> None:
    print(printable(line), file=sys.stderr, flush=True)
