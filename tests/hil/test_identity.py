"""Certificates between real processes: who has one works, a stranger gets nowhere.

The cells and commands are those of config/guides/network.md, as they stand there, but
for hosts and ports of this machine.
"""

import re
import shlex
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from telerobot import Operator, OperatorError
from telerobot.config.load import altered, load_cell
from telerobot.protocols.messages.rig import RigFault
from telerobot.tools.host.local_plant import LocalPlant, end
from telerobot.tools.host.machine import free_port

pytestmark = pytest.mark.hil

GUIDE = Path(__file__).resolve().parents[2] / "config/guides/network.md"
START_S = 60.0
"""Wall time after which what does not come up, or about, is a failure [s]."""

PLAY_S = 180.0
"""The same of a script, which is played in a process that has to start first [s]."""


class Page:
    """A section of the page, for a machine where all happens at one port of loopback."""

    def __init__(self, title):
        text = GUIDE.read_text(encoding="utf-8").split(f" {title}\n", 1)[1]
        text = text.split("\n#", 1)[0]
        self._here = f"127.0.0.1:{free_port(socket.SOCK_STREAM)}"
        self._text = re.sub(r"(0\.0\.0\.0|arm\.local|hub\.local):7447", self._here, text)

    @property
    def endpoint(self):
        return f"tls/{self._here}"

    def cell(self, extends="pa10"):
        """Return the cell file that the section shows."""
        (found,) = re.findall(r"```toml\n(.*?)```", self._text, re.DOTALL)
        return found.replace('"pa10"', f'"{extends}"')

    def command(self, begins):
        """Return the one command line that begins so, as arguments."""
        (found,) = (line for line in self._text.splitlines() if line.startswith(begins))
        first, *rest = shlex.split(found.replace("hub.local", "127.0.0.1"))
        program = [sys.executable, *(["-m", "telerobot.tools.cli"] if first == "telerobot" else [])]
        return [*program, *rest]


def run(arguments, **options):
    done = subprocess.run(
        arguments, capture_output=True, text=True, timeout=120, check=False, **options
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def mode(operator):
    operator.turn()
    return None if operator.state is None else operator.state.mode


def nobody_answers(*arguments, **options):
    with pytest.raises(OperatorError) as caught:
        Operator(*arguments, **options)
    return caught.value.reason == "no_daemon"


class There(LocalPlant):
    """A plant whose daemon is reached where its cell's file says."""

    def __init__(self, cell):
        super().__init__(cell)
        self.cell = altered(self.cell, {"zenoh": cell.config.zenoh})
        self.rig_endpoint = cell.config.zenoh.endpoint


def test_an_operator_on_a_second_machine_drives_and_a_stranger_gets_nowhere(tmp_path, monkeypatch):
    page = Page("Who may speak")
    arm, second, stranger = (tmp_path / name for name in ("arm", "second", "stranger"))
    for machine in (arm, second / "keys", stranger):
        machine.mkdir(parents=True)
    monkeypatch.chdir(arm)
    Path("arm.toml").write_text(page.cell())
    run(page.command("telerobot certify"))
    assert "0 errors, 0 warnings" in run(page.command("telerobot check"))
    for name in ("authority.crt", "operator-ann.crt", "operator-ann.key"):
        (second / "keys" / name).write_bytes((arm / "keys" / name).read_bytes())
    run([*page.command("telerobot certify"), "--directory", str(stranger / "keys")])

    with There(load_cell(arm / "arm.toml")) as plant:
        plant.wait(plant.answers, START_S, "the daemon does not listen")
        with Operator(plant.cell, identity="keys/observer-bob") as bob:
            plant.wait(lambda: mode(bob) == "ready", START_S, "the daemon is not ready")
            plant.wait(lambda: mode(bob) and bob.description, START_S, "no description")
            assert bob.description.network == "certified"

            before = bob.state.q
            with subprocess.Popen(page.command("telerobot drive"), cwd=second) as drive:
                plant.wait(lambda: mode(bob) and drive.poll() is not None, PLAY_S, "it goes on")
            assert drive.returncode == 0
            assert bob.state.q != pytest.approx(before, abs=0.1), "nothing has moved"

            with pytest.raises(OperatorError) as caught:
                bob.acquire()
            assert caught.value.reason == "not_certified"
            assert "observer-bob may not send on telerobot/pa10/operator/lease" in str(caught.value)

        run([*page.command("telerobot certify"), "--operator", "carol"])
        with (
            Operator(plant.cell, identity="keys/operator-carol") as carol,
            pytest.raises(OperatorError, match="does its daemon know operator-carol"),
        ):
            carol.wait_state(1.0)

        monkeypatch.chdir(stranger)
        assert nobody_answers("pa10", endpoint=page.endpoint.replace("tls/", "tcp/"))
        assert nobody_answers("pa10", endpoint=page.endpoint, identity="keys/operator-ann")
        done = subprocess.run(
            page.command("telerobot drive"), capture_output=True, text=True, check=False
        )
        assert done.returncode == 1
        assert "no_daemon: nobody answers" in done.stderr
        with (
            Operator(plant.cell, identity=second / "keys" / "operator-ann") as ann,
            pytest.raises(OperatorError, match="not_certified"),
        ):
            ann.inject(RigFault(kind="silence", target="e1"))


def test_a_rovers_scanner_is_heard_by_its_certificate_and_does_not_start_without(
    tmp_path, monkeypatch
):
    page = Page("Who may speak")
    monkeypatch.chdir(tmp_path)
    scanner = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    Path("arm.toml").write_text(
        page.cell("rover_bridge") + f'[scanner]\naddress = "{scanner}"\n[rig]\nbridge = {{}}\n'
    )
    run([*page.command("telerobot certify"), "--sensor", "scan"])
    with There(load_cell("arm.toml")) as plant:
        plant.wait(plant.answers, START_S, "the daemon does not listen")
        with Operator(plant.cell, identity="keys/observer-bob") as bob:

            def heard(event):
                return mode(bob) and event in [each.name for each in bob.events]

            plant.wait(lambda: mode(bob) is not None, START_S, "the daemon tells nothing")
            end(plant.scan)  # it may have been heard before bob was there
            plant.start_scan()
            plant.wait(lambda: heard("scanner_heard"), START_S, "no contour comes through")
            end(plant.scan)
            plant.wait(lambda: heard("scanner_silent"), START_S, "it looks on without its process")
            for kept in ("sensor-scan.crt", "sensor-scan.key"):
                Path("keys", kept).unlink()
            done = subprocess.run(
                [sys.executable, "-m", "telerobot.tools.cli", "scan", "arm.toml"],
                capture_output=True, text=True, timeout=60, check=False,
            )  # fmt: skip
            assert done.returncode == 2
            assert "sensor" in done.stderr
            assert len(done.stderr.splitlines()) == 1


class Router:
    """The router's process, started as the page says, in its folder."""

    def __init__(self, page):
        self._process = subprocess.Popen(page.command("python -c"), cwd="keys")

    def end(self):
        end(self._process)


def test_two_daemons_and_their_operators_meet_at_a_router(tmp_path, monkeypatch):
    page = Page("Several arms behind one router")
    monkeypatch.chdir(tmp_path)
    for cell in ("pa10", "ur5e"):
        Path(f"{cell}.toml").write_text(page.cell(cell))
    certify = [*page.command("telerobot certify"), "--listen", page.endpoint]
    run(certify)
    run([*certify, "--directory", "strangers"])
    first, second = (load_cell(tmp_path / f"{cell}.toml") for cell in ("pa10", "ur5e"))
    router = None
    try:
        with There(first) as one, There(second) as other:

            def waiting():
                return "waiting: zenoh.router" in one.complaints()

            one.wait(waiting, START_S, "the daemon does not wait for the router")
            router = Router(page)
            one.wait(one.answers, START_S, "the router does not listen")
            with Operator(first, name="ann") as ann, Operator(second, name="ann") as beth:
                one.wait(lambda: mode(ann) == "ready", START_S, "the first daemon is not ready")
                other.wait(lambda: mode(beth) == "ready", START_S, "the second is not ready")
                ann.acquire()
                beth.acquire()
                ann.enable()
                before = ann.state.pose_mrf[2], beth.state.q
                ann.joystick([0, 0, 0.03, 0, 0, 0], expressed_in="base")
                one.wait(
                    lambda: mode(ann) and ann.state.pose_mrf[2] > before[0] + 0.02,
                    START_S,
                    "the first arm does not move",
                )
                beth.turn()
                assert beth.state.q == pytest.approx(before[1], abs=1e-3)
                assert nobody_answers(first, identity="strangers/operator-ann")

                router.end()
                router = Router(page)
                one.wait(lambda: mode(ann) == "hold", START_S, "the arm did not stop and hold")
                assert not ann.holds_lease
                ann.acquire()
                ann.enable()
                tick = beth.state.tick
                other.wait(lambda: mode(beth) and beth.state.tick > tick, START_S, "no telemetry")
    finally:
        if router is not None:
            router.end()
