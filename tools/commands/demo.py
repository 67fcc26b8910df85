"""`telerobot demo [CELL]`: virtual hardware and daemon on this machine, ready to drive."""

import argparse
import json
import os
import secrets
import socket
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

from ...config.errors import printable
from ...config.load import ConfigError, load_cell
from ...drivers.network.identity import identity_of
from ...protocols.messages.telemetry import Event
from ...protocols.topics import Role
from ..client.operator import Operator, OperatorError
from ..host.address import moved
from ..host.local_plant import ChildDied, LocalPlant, recording
from ..host.machine import Claims, free_port, own_endpoint
from ..host.progress import say
from ..operator.terminal import is_terminal
from ..scripts.live_run import LiveRun
from ..scripts.script import Script, load_script
from .drive import drive

READY_WITHIN_S = 90.0
"""A daemon that is not ready by then will not be [s]; the very first start compiles kernels."""

JITTER = ("lateness_us_p50", "lateness_us_p99", "lateness_us_max")
PORT = 8080  # the page's port, if it is free


def run(args: argparse.Namespace) -> int:
    """Show a cell at work. Raises `ConfigError`."""
    cell = moved(load_cell(args.cell), identity=args.identity)
    if any(bus.interface != "loopback" for bus in cell.config.fieldbuses):
        raise ConfigError(f"{cell.path}: bus.interface: the demo runs on 'loopback' only")
    if cell.config.rig is None:
        raise ConfigError(f"{cell.path}: rig: missing: there is nothing to show")
    headless = args.headless or args.json
    script = load_script(args.script or cell.default_script) if headless else None
    if script is None and not is_terminal():
        print("telerobot: no terminal: the demo plays a script (--headless)", file=sys.stderr)
        script = load_script(args.script or cell.default_script)
    with tempfile.TemporaryDirectory() as folder:
        statistics = Path(folder) / "statistics.json"
        claims = Claims()
        endpoint, why_not = own_endpoint(cell, claims)
        with (
            LocalPlant(cell, statistics, args.record, endpoint=endpoint) as plant,
            recording(plant.cell, args.record),
        ):
            where = plant.cell.config.zenoh.listen
            say(f"{cell.config.name} listens at {where}" + (f": {why_not}" if why_not else ""))
            try:
                told = [] if script is not None or args.no_page else _start_page(plant, claims)
                show = _Show(plant)
                show.wait_ready()
                if script is None:
                    drive(show.operator, plant.revive, told)
                else:
                    show.play(script, args.seconds)
            except (ChildDied, OperatorError) as error:
                plant.stop()
                print(plant.complaints(), end="", file=sys.stderr)
                say(f"telerobot: {error}")
                return 1
            show.operator.close()
            healthy = plant.stop()
        if not healthy:
            print(plant.complaints(), end="", file=sys.stderr)
        if script is None:
            return 0 if healthy else 1
        summary = show.summary(json.loads(statistics.read_text()) if healthy else {})
        print(json.dumps(summary) if args.json else table(summary))
        return 0 if healthy and summary["healthy"] else 1


class _Show:
    """An operator at a plant of our own, and what it saw."""

    def __init__(self, plant: LocalPlant) -> None:
        self._plant = plant
        self._errors: list[Event] = []
        self._refused: list[str] = []
        self._failure = ""
        self._rounds = 0
        plant.wait(plant.answers, READY_WITHIN_S, "the daemon does not listen")
        judge = identity_of(plant.cell, Role.JUDGE, plant.cell.config.name)
        stem = None if judge is None else judge.folder / judge.certificate.name
        self.operator = Operator(plant.cell, name="demo", identity=stem)

    def wait_ready(self) -> None:
        """Wait until the daemon tells its state. Raises `ChildDied`, `OperatorError`."""

        def told() -> bool:
            self.operator.turn()
            return self.operator.state is not None

        self._plant.wait(told, READY_WITHIN_S, "the daemon tells nothing")

    def play(self, script: Script, seconds: float) -> None:
        """Play a script over and over. Raises `ChildDied`."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s and not self._failure:
            run = LiveRun(self.operator, script, say)
            run.play(end_s, self._plant.raise_if_dead)
            self._rounds += 1
            self._errors += [event for event in run.events if event.severity == "error"]
            self._refused += run.player.refused
            self._failure = run.failure

    def summary(self, statistics: dict[str, float]) -> dict[str, object]:
        """Return what the headless demo showed."""
        state = self.operator.state
        mode = "unknown" if state is None else state.mode
        errors = [{"t_s": e.time_s, "name": e.name, "detail": e.detail} for e in self._errors]
        failure = self._failure or None
        return {
            "cell": self._plant.cell.config.name,
            "rounds": self._rounds,
            "mode": mode,
            "failure": failure,
            "refused": self._refused,
            "errors": errors,
            **statistics,
            "healthy": bool(statistics) and not errors and failure is None and mode != "fault",
        }


def table(summary: dict[str, object]) -> str:
    """Return the summary of a headless demo, a line each, whoever worded what is in it."""
    late = "/".join(f"{summary.get(key, 0):.0f}" for key in JITTER)
    error = summary.get("worst_following_error_rad", 0.0)
    rows = {
        "rounds": summary["rounds"],
        "ticks": summary.get("ticks", 0),
        "overruns": summary.get("overruns", 0),
        "SYNC late p50/p99/max": f"{late} µs",
        "worst tracking error": f"{1e3 * error:.2f} mrad" if isinstance(error, float) else "",
        "final mode": summary["mode"],
        "refused": summary["refused"] or "nothing",
        "errors": summary["errors"] or "none",
        "failure": summary["failure"] or "none",
    }
    return "\n".join(printable(f"{name:<22} {value}", 100_000) for name, value in rows.items())


def _start_page(plant: LocalPlant, claims: Claims) -> list[str]:
    """Start the console; return its address in words, or why there is none."""
    if find_spec("aiohttp") is None:
        return ["no page in the browser: pip install 'telerobot[console]'"]
    from ..operator.web import cli as page

    if not page.FETCHED.is_file():
        return ["no page in the browser: its JavaScript is not there (make venv fetches it)"]
    taken = claims.take(PORT)
    port = free_port(socket.SOCK_STREAM) if taken else PORT
    operators, observers = secrets.token_urlsafe(24), secrets.token_urlsafe(24)
    plant.start_console([f"--listen=127.0.0.1:{port}"], {page.KEYS: f"{operators},{observers}"})
    address = f"http://127.0.0.1:{port}/?key={operators}"
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        page.open_page(address)
    other = f" (port {PORT}: {taken})" if taken else ""
    return [
        f"the page: {address}{other}",
        f"to watch only: http://127.0.0.1:{port}/?key={observers}",
    ]
