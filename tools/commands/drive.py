"""`telerobot drive CELL [SCRIPT]`: a remote operator in the terminal, or a script's operators."""

import argparse
import time
from collections.abc import Callable, Sequence
from functools import partial

from ..client.operator import Operator, OperatorError
from ..client.protocol_client import ignore
from ..host.address import cell_from
from ..host.progress import say
from ..operator.terminal import Console, Decoder, KeyboardTeleop, is_terminal
from ..operator.words import event_line
from ..scripts.live_run import LiveRun
from ..scripts.script import load_script

POLL_S = 0.004
REDRAW_S = 0.1

FIRST_STATE_S = 0.5  # the lease is asked for once telemetry comes, or after this long [s]


def run(args: argparse.Namespace) -> int:
    """Drive a cell whose daemon runs. Raises `ConfigError`."""
    cell = cell_from(args)
    script = None if args.script is None else load_script(args.script)
    if script is None and not is_terminal():
        say("telerobot: drive needs a terminal, or a SCRIPT to play")
        return 2
    try:
        with Operator(cell, name=args.name) as operator:
            if script is not None:
                return LiveRun(operator, script, partial(print, flush=True)).run()
            drive(operator)
    except OperatorError as error:
        say(f"telerobot: {error}")
        return 1
    return 0


def drive(
    operator: Operator,
    watch: Callable[[Callable[[str], None]], None] = ignore,
    page: Sequence[str] = (),
) -> None:
    """Let a person at the keyboard drive, until they leave.

    `watch` is called all the while, with what prints a line, and may raise; the terminal is
    restored all the same. Where there is a `page` besides, of which these lines tell, the lease is
    left to who moves first.
    """
    with Console() as console:
        teleop, decoder = KeyboardTeleop(operator, console.say), Decoder()
        # Who asked has the reply.
        operator.on_event = lambda event: (
            None if event.name == "request_refused" else console.say(event_line(event))
        )
        teleop.help()
        operator.spin(FIRST_STATE_S, lambda: operator.state is not None)
        for line in page:
            console.say(line)
        if page:
            console.say("page or keys: m takes the lease, if it is free, and enables the arm")
        else:
            teleop.acquire()
        redraw_s = 0.0
        while not (teleop.quit or console.ended):
            for key in decoder.keys(console.read(POLL_S)):
                teleop.press("q" if key == "ctrl-c" else key, time.monotonic())
            teleop.run(time.monotonic())
            operator.turn()
            watch(console.say)
            now_s = time.monotonic()
            if now_s >= redraw_s:
                redraw_s = now_s + REDRAW_S
                console.show(*teleop.lines(now_s))
