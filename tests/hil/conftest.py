"""Rig and daemon as real processes, for tests that are judged by the physics.

A `Plant` starts both on a multicast group and ports of their own. Nothing here sleeps for an
event: `until` and `run_for` wait by the rig's physics time, and turn every operator meanwhile, so
that leases live. What the processes wrote is shown when a test fails.
"""

import json
import math
import os
import re
import signal
import socket
import time
from pathlib import Path

import pytest
import zenoh
from _pytest.runner import runtestprotocol
from telerobot.config.load import load_cell
from telerobot.protocols import topics as t
from telerobot.protocols.codec import decode_as, encode
from telerobot.protocols.messages.rig import RigFault, RigTruth
from telerobot.tools.client.operator import Operator
from telerobot.tools.host.address import moved
from telerobot.tools.host.local_plant import LocalPlant, end
from telerobot.tools.host.machine import free_port

START_S = 150.0 if os.environ.get("TELEROBOT_CAN") else 60.0
"""Wall time after which a process that does not show up is a failure [s]."""

STUCK_S = 60.0
"""Wall time after which physics that stand still are a failure [s]."""


LOST_MS = pytest.StashKey[int]()
"""Time in which the rigs of a test got to make no physics [ms]."""
REPEATED = pytest.StashKey[list[str]]()
"""Tests that were run again, and why."""

KERNEL_BUS = os.environ.get("TELEROBOT_CAN", "")
"""Kernel's CAN buses to take in place of loopback: `vcan` for vcan0, vcan1, …; empty for none."""


def over_kernel(cell, folder):
    """Return a cell whose buses are the kernel's, as python-can's `socketcan` sees them."""
    text = re.sub(r"^interface = .*\n", "", cell.path.read_text(encoding="utf-8"), flags=re.M)
    kernel = re.sub(r"^(\[bus\]|\[\[buses\]\])$", r'\1\ninterface = "socketcan"', text, flags=re.M)
    path = folder / cell.path.name
    path.write_text(kernel, encoding="utf-8")
    names = [bus.name for bus in cell.config.fieldbuses]
    return moved(
        load_cell(path),
        endpoint=cell.config.zenoh.endpoint,
        channels=[f"{name}={KERNEL_BUS}{i}" for i, name in enumerate(names)],
    )


def judge_config(endpoint, daemon):
    """Return a router's configuration: the rig dials it, and it looks for the daemon for ever."""
    config = zenoh.Config()
    settings = {
        "mode": "router",
        "listen/endpoints": [endpoint],
        "connect/endpoints": [daemon],
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


class Plant(LocalPlant):
    """One cell's rig and daemon, the rig's truth, and any number of operators.

    The rig tells its truth to a router of the test's own, so that it is heard when the daemon is
    dead; that router looks for the daemon's, so that a script's faults find the rig.
    """

    def __init__(self, cell, statistics=None):
        super().__init__(cell, statistics)
        if KERNEL_BUS:
            self.cell = over_kernel(self.cell, Path(self._folder.name))
        self.operators = []
        self.rig_endpoint = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
        daemon = self.cell.config.zenoh.listen
        self._session = zenoh.open(judge_config(self.rig_endpoint, daemon))
        name = self.cell.config.name
        self._truths = self._session.declare_subscriber(
            t.RIG_TRUTH.full_key(name), zenoh.handlers.RingChannel(256)
        )
        self._faults = self._session.declare_publisher(t.RIG_FAULT.full_key(name))
        self.truth = None
        """What the physics say is true now: the newest `RigTruth`."""
        self.pause_s, self._turned_s = 0.0, math.inf
        """The longest time between two turns, in which no operator was alive [s]."""
        self.truths = []
        """Every truth that was read."""
        self._ahead = -math.inf
        """The rig's count of SYNCs less the tick that one begins, or more: truths are read last."""
        self.lost_ms = 0
        """Time in which its rigs got to make no physics, known at the end [ms]. They skip steps
        where they were late by two periods with no frame waiting: then the machine stood still, and
        with it the daemon. A daemon that is late makes no rig late."""

    def __enter__(self):
        super().__enter__()
        try:
            self._wait_started()
        except BaseException:
            self.stop()
            print(self.complaints())
            raise
        return self

    def __exit__(self, kind, error, trace):
        for operator in self.operators:
            operator.session.close()
        self.cont_daemon()
        self.stop()
        print(self.complaints())
        self._session.close()
        super().__exit__(kind, error, trace)

    def stop(self):
        """End all; say whether rig and daemon ended well, and keep how much time rigs lost."""
        well = super().stop()
        told = re.findall(r"^rig: \d+ steps, (\d+) skipped", self.complaints(), flags=re.M)
        self.lost_ms = round(sum(map(int, told)) * 1e3 * self.cell.config.rig.physics_step_s)
        return well

    def _wait_started(self):
        self.wait(self.answers, START_S, "the daemon does not listen")
        self.wait(self._read_truth, START_S, "the rig tells no truth")

    # --- operators -----------------------------------------------------------------------------

    def operator(self, name="operator"):
        """Return an operator that has seen the daemon READY, or in whatever mode it is later."""
        operator = Operator(self.cell, name=name)
        self.operators.append(operator)
        self.wait_wall(lambda: operator.state is not None, "no telemetry")
        return operator

    def enabled_operator(self, name="operator"):
        """Return an operator with the lease, and the arm enabled."""
        operator = self.operator(name)
        self.wait_wall(lambda: operator.state.mode in ("ready", "hold"), "not ready")
        operator.acquire()
        operator.enable()
        return operator

    def inject(self, kind, target, **more):
        """Inject a fault into the virtual hardware, or take it back with `on=False`."""
        self._faults.put(encode(RigFault(kind=kind, target=target, **more)))

    # --- the daemon's process ------------------------------------------------------------------

    def kill9_daemon(self):
        """Kill the daemon on the spot."""
        self.daemon.kill()
        self.daemon.wait()

    def stop_daemon(self):
        """Freeze the daemon (SIGSTOP): alive, and doing nothing."""
        self.daemon.send_signal(signal.SIGSTOP)

    def cont_daemon(self):
        """Let a frozen daemon go on."""
        if self.daemon is not None and self.daemon.poll() is None:
            self.daemon.send_signal(signal.SIGCONT)

    def end_daemon(self):
        """Ask the daemon to end; return its exit code."""
        return end(self.daemon)

    # --- waiting -------------------------------------------------------------------------------

    def turn(self):
        """Let every operator send and read what is due, and read the rig's truth."""
        now_s = time.monotonic()
        self.pause_s, self._turned_s = max(self.pause_s, now_s - self._turned_s), now_s
        for operator in self.operators:
            operator.turn()
        self._read_truth()
        ticks = [operator.state.tick for operator in self.operators if operator.state]
        self._ahead = max([self._ahead, *(self.truth.sync_count - tick for tick in ticks)])
        time.sleep(0.002)

    def until(self, done, within_s, why="it did not come about"):
        """Wait until something holds; fail when it does not within so much physics time [s]."""
        start_s, seen_s, wall_s = self.truth.time_s, self.truth.time_s, time.monotonic()
        while not done():
            self.turn()
            if self.truth.time_s > seen_s:
                seen_s, wall_s = self.truth.time_s, time.monotonic()
            late = self.truth.time_s - start_s > within_s
            assert not late, f"{why} within {within_s} s; {self.told()}"
            assert time.monotonic() - wall_s < STUCK_S, f"the physics stand still; {self.told()}"

    def reach(self, operator, within_s):
        """Wait until an operator's newest goal is reached, within so much physics time [s]."""
        self.until(lambda: operator.wait_goal(0.0), within_s, "the goal is not reached")

    def run_for(self, physics_s):
        """Let so much physics time pass [s]."""
        end_s = self.truth.time_s + physics_s
        self.until(lambda: self.truth.time_s >= end_s, physics_s + 60.0)

    def newer_truth(self, operator):
        """Wait for a truth of a SYNC after the one that an operator's newest state is of."""
        told = operator.state.tick
        self.until(lambda: self.truth.sync_count > told + self._ahead, 2.0, "no truth is newer")

    def wait_wall(self, done, why):
        """Wait for processes to come up, which physics time does not measure."""
        deadline_s = time.monotonic() + START_S
        while not done():
            self.turn()
            assert time.monotonic() < deadline_s, f"{why}; {self.told()}"

    def told(self):
        """Return what the operators know, mode and newest events, for a failure's message."""
        syncs = self.truth.sync_count if self.truth else 0
        lines = [f"{syncs} SYNCs, operators turned at least every {self.pause_s:.3f} s"]
        for operator in self.operators:
            events = [f"{e.tick} {e.severity} {e.name} {e.values}" for e in operator.events[-8:]]
            mode = operator.state.mode if operator.state else "no telemetry"
            lines += [f"{operator.client.name} in {mode}:", *events]
        return "\n".join(lines)

    def _read_truth(self):
        while (sample := self._truths.try_recv()) is not None:
            self.truth = decode_as(RigTruth, sample.payload.to_bytes(), t.RIG_TRUTH.max_bytes)
            self.truths.append(self.truth)
        return self.truth is not None


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item, nextitem):
    """Run a test once more that failed where the machine stood still: it has shown nothing.

    The arm holds where its daemon gets no processor for so long, as it should, and nearly every
    test here moves it. The witness is another process than what is tested: the rig.
    """
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    reports = runtestprotocol(item, nextitem=nextitem, log=False)
    lost_ms = item.stash.get(LOST_MS, 0)
    if lost_ms and any(report.failed for report in reports):
        again = item.config.stash.setdefault(REPEATED, [])
        again.append(f"{item.nodeid}: its rig got no processor for {lost_ms} ms")
        item.stash[LOST_MS] = 0
        item._initrequest()
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def pytest_terminal_summary(terminalreporter, config):
    """Say which tests were run twice, and why."""
    for line in config.stash.get(REPEATED, []):
        terminalreporter.write_line(f"run again, {line}")


@pytest.fixture
def make_plant(tmp_path, request):
    """Return a function that starts a plant of a cell; all of them end with the test."""
    plants = []

    def make(cell="pa10", statistics: Path | None = None):
        plant = Plant(load_cell(cell), statistics)
        plants.append(plant)
        return plant.__enter__()

    yield make
    for plant in plants:
        plant.__exit__(None, None, None)
        lost_ms = request.node.stash.get(LOST_MS, 0)
        request.node.stash[LOST_MS] = lost_ms + plant.lost_ms


@pytest.fixture
def plant(make_plant):
    """Return a running PA-10."""
    return make_plant()
