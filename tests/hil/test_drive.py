"""`telerobot drive` under a terminal of the test's own, and with a script."""

import fcntl
import os
import pty
import signal
import socket
import struct
import subprocess
import sys
import termios
import threading
from functools import partial

import numpy as np
import pytest
from telerobot.tools.host.address import options
from telerobot.tools.host.machine import free_port

pytestmark = pytest.mark.hil

DRIVE = [sys.executable, "-m", "telerobot.tools.cli", "drive"]


class Terminal:
    """A program under a pseudo-terminal: what is typed goes in, `text` is what it showed."""

    def __init__(self, *arguments):
        self.master, self.slave = pty.openpty()
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 200, 0, 0))
        self.found = termios.tcgetattr(self.slave)
        self.text = ""
        self.program = subprocess.Popen(
            arguments, stdin=self.slave, stdout=self.slave, stderr=self.slave,
            start_new_session=True,
        )  # fmt: skip
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        while True:
            try:
                data = os.read(self.master, 4096)
            except OSError:
                return
            self.text += data.decode("utf-8", "replace")

    def type(self, keys):
        os.write(self.master, keys.encode())

    def restored(self):
        return termios.tcgetattr(self.slave) == self.found and self.text.endswith("\x1b[?25h")

    def close(self):
        if self.program.poll() is None:
            self.program.kill()
        self.program.wait()
        os.close(self.slave)
        os.close(self.master)
        self._reader.join()


@pytest.fixture
def open_terminal():
    """Return a function that starts `telerobot drive` on a plant, in a terminal."""
    terminals = []

    def start(plant, *extra):
        cell, endpoint, *_ = options(plant.cell)
        terminals.append(Terminal(*DRIVE, cell, endpoint, "--name", "ann", *extra))
        return terminals[-1]

    yield start
    for each in terminals:
        each.close()


@pytest.fixture
def terminal(plant, open_terminal):
    """Return a function that starts it on the PA-10."""
    return partial(open_terminal, plant)


def wait_text(plant, terminal, text, within_s=20.0):
    plant.until(lambda: text in terminal.text, within_s, f"{text!r} was not shown")


def wait_restored(plant, terminal, within_s=5.0):
    """Wait until the program has ended and the terminal is as it found it."""
    plant.until(lambda: terminal.program.poll() is not None, 10.0)
    try:
        plant.until(terminal.restored, within_s)
    except AssertionError as error:
        settings = termios.tcgetattr(terminal.slave)
        changed = [i for i, found in enumerate(terminal.found) if settings[i] != found]
        error.add_note(f"settings {changed} differ; it showed at last {terminal.text[-400:]!r}")
        raise


def hold_key(plant, terminal, key, physics_s):
    """Send a key as a terminal does while it is held: once, a pause, then repeats."""
    start_s = plant.truth.time_s
    terminal.type(key)
    plant.run_for(0.4)
    while plant.truth.time_s - start_s < physics_s:
        terminal.type(key)
        plant.run_for(0.03)


def fastest_rise(plant, window_s):
    """Return the greatest mean upward speed of the tool over a window of physics time [m/s]."""
    times = np.array([t.time_s for t in plant.truths])
    heights = np.array([t.pose_mrf[2] for t in plant.truths])
    later = np.searchsorted(times, times + window_s)
    inside = later < len(times)
    rise = heights[later[inside]] - heights[inside]
    return float((rise / (times[later[inside]] - times[inside])).max())


def height(plant):
    return plant.truth.pose_mrf[2]


def test_a_held_key_moves_the_arm_and_letting_go_stops_it(plant, terminal):
    watcher = plant.operator("watcher")
    screen = terminal()
    wait_text(plant, screen, "lease granted to ann")
    screen.type("m")
    wait_text(plant, screen, "enable: done")  # the console has to know, not only the daemon
    before = height(plant)
    hold_key(plant, screen, "r", 1.5)
    # How long a busy machine's terminal bridges the first repeat varies; the speed does not.
    assert 0.03 < height(plant) - before < 0.1
    assert fastest_rise(plant, 0.3) == pytest.approx(0.05, abs=0.005)
    plant.run_for(0.8)
    rest = plant.truth.pose_mrf[:3]  # the tool: joints still seek the middle of their ranges
    plant.run_for(0.5)
    assert plant.truth.pose_mrf[:3] == pytest.approx(rest, abs=1e-3)
    assert watcher.state.mode == "enabled"
    assert "ENABLED | xyz" in screen.text
    assert "lease ann (you) | round trip" in screen.text

    screen.type("q")
    wait_restored(plant, screen)
    assert screen.program.returncode == 0
    plant.until(lambda: watcher.state.mode == "hold", 3.0)


def test_held_keys_insert_and_withdraw_a_snake_of_thirty_drives_on_two_buses(
    make_plant, open_terminal
):
    plant = make_plant("snake")
    watcher = plant.operator("watcher")
    depth = lambda: (watcher.state.insertion or {}).get("depth", 0.0)  # noqa: E731
    speed = lambda: (watcher.state.insertion or {}).get("speed", 1.0)  # noqa: E731

    def hold_until(key, reached):
        start_s = plant.truth.time_s
        while not reached():
            assert plant.truth.time_s < start_s + 10.0, f"{key!r} does not get there"
            screen.type(key)
            plant.run_for(0.03)

    screen = open_terminal(plant)
    wait_text(plant, screen, "lease granted to ann", 60.0)  # two processes start beside it
    screen.type("m")
    wait_text(plant, screen, "enable: done")
    before = depth()
    hold_until("v", lambda: depth() > before + 0.05)
    plant.until(lambda: speed() == 0.0, 3.0, "letting go does not stop it")
    rest = depth()
    plant.run_for(0.3)
    assert depth() == pytest.approx(rest, abs=1e-3)
    hold_until("b", lambda: depth() < rest - 0.03)
    plant.until(lambda: speed() == 0.0, 3.0, "letting go does not stop it")
    assert watcher.state.mode == "enabled"
    assert plant.truth.clearance_m > 0.008
    assert plant.truth.contact_force == (0.0, 0.0, 0.0)


@pytest.mark.alone
def test_held_keys_drive_a_rover_to_a_bridge_where_its_arm_folds_by_itself(
    make_plant, open_terminal, tmp_path
):
    near = tmp_path / "near.toml"
    scanner = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    # Six processes share what processors there are.
    near.write_text(
        f'extends = "rover_bridge"\n[scanner]\naddress = "{scanner}"\nsilent_s = 0.5\n'
        "[rig.bridge]\ndistance = 2.3\n"
    )
    plant = make_plant(near)
    watcher = plant.operator("watcher")
    x = lambda: plant.truth.frames["base"][0]  # noqa: E731
    arm = lambda: np.array(plant.truth.q[2:9])  # noqa: E731
    told = lambda: [event.name for event in watcher.events]  # noqa: E731

    def hold_until(key, reached, within_s):
        start_s = plant.truth.time_s
        while not reached():
            assert plant.truth.time_s < start_s + within_s, f"{key!r} does not get there: {told()}"
            screen.type(key)
            plant.run_for(0.03)

    screen = open_terminal(plant)
    wait_text(plant, screen, "lease granted to ann", 60.0)  # three processes start beside it
    plant.until(lambda: "scanner_heard" in told(), 30.0, "nobody looks ahead")
    screen.type("m")
    wait_text(plant, screen, "enable: done")
    home = arm()
    hold_until("v", lambda: np.abs(arm() - home).max() > 0.2, 20.0)
    assert 0.1 < x() < 2.3 - 0.8
    assert told().index("passage_undecided") < told().index("passage_folding")
    rest = x()
    hold_until("b", lambda: x() < rest - 0.05, 5.0)
    assert watcher.state.mode == "enabled"
    assert plant.truth.clearance_m > 0.05
    assert plant.truth.contact_force == (0.0, 0.0, 0.0)


def test_space_stops_the_arm_and_its_refusals_are_said(plant, terminal):
    watcher = plant.operator("watcher")
    screen = terminal()
    wait_text(plant, screen, "lease granted to ann")
    screen.type("m")
    plant.until(lambda: watcher.state.mode == "enabled", 10.0)
    screen.type(" ")
    plant.until(lambda: watcher.state.mode == "hold", 3.0)
    assert watcher.state.protective_stop
    screen.type("m")
    wait_text(plant, screen, "enable: refused: protective_stop")
    screen.type("c")
    wait_text(plant, screen, "clear: done")
    screen.type("m")
    plant.until(lambda: watcher.state.mode == "enabled", 5.0)
    assert "Traceback" not in screen.text


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_leaves_the_terminal_as_it_was_and_the_arm_holding(plant, terminal, number):
    watcher = plant.operator("watcher")
    screen = terminal()
    wait_text(plant, screen, "lease granted to ann")
    screen.type("m")
    plant.until(lambda: watcher.state.mode == "enabled", 10.0)
    screen.program.send_signal(number)
    wait_restored(plant, screen)
    plant.until(lambda: watcher.state.mode == "hold", 3.0)


def test_who_holds_the_lease_is_said_and_it_can_be_asked_for_again(plant, terminal):
    other = plant.operator("bob")
    other.acquire()
    screen = terminal()
    wait_text(plant, screen, "bob holds the lease")
    other.release()
    screen.type("L")
    wait_text(plant, screen, "lease granted to ann")
    screen.type("tq")  # the reply comes while the lease is given back
    wait_restored(plant, screen)


def test_a_daemon_that_vanishes_is_said_and_the_console_lives_on(plant, terminal):
    screen = terminal()
    wait_text(plant, screen, "READY | xyz")
    plant.kill9_daemon()
    wait_text(plant, screen, "no telemetry for 1")
    plant.start_daemon()
    seen = len(screen.text)
    plant.until(lambda: "READY | xyz" in screen.text[seen:], 30.0)
    seen = len(screen.text)
    screen.type("L")
    plant.until(lambda: "m enables the arm" in screen.text[seen:], 10.0)
    screen.type("q")
    wait_restored(plant, screen)


def test_a_script_is_played_on_a_running_daemon(plant):
    cell, endpoint, *_ = options(plant.cell)
    with subprocess.Popen(
        [*DRIVE, cell, "pose_move", endpoint], stdout=subprocess.PIPE, text=True
    ) as child:
        plant.until(lambda: child.poll() is not None, 40.0)
        out = child.stdout.read()
    assert child.returncode == 0, out
    last = out.splitlines()[-1]
    assert last.startswith("mode enabled, at_goal true, tool error commanded "), out
    assert "refused" not in out


def test_without_terminal_or_script_drive_is_bad_usage():
    done = subprocess.run(
        [*DRIVE, "pa10"], check=False, stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stderr == "telerobot: drive needs a terminal, or a SCRIPT to play\n"
