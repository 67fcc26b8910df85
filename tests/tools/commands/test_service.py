"""`telerobot service`: a unit that systemd takes, whose command is ours, for any cell."""

import re
import shlex
import shutil
import subprocess

import pytest
from telerobot.tools.cli import COMMANDS, build_parser, main


@pytest.fixture
def printed(capsys):
    """Return a function that prints a unit, and returns it."""

    def unit(*argv):
        assert main(["service", *argv]) == 0
        return capsys.readouterr().out

    return unit


@pytest.fixture
def real(tmp_path):
    """A cell on two SocketCAN interfaces, in a folder whose name has a blank and signs in it."""
    folder = tmp_path / "cell 100%; $HOME"
    folder.mkdir()
    cell = folder / "real.toml"
    cell.write_text(
        'extends = "pa10"\nname = "real"\ndescription = "100 % steel"\n'
        '[bus]\ninterface = "socketcan"\nchannel = "can0"\n'
    )
    return cell


def lines(unit, key):
    return [line.partition("=")[2] for line in unit.splitlines() if line.startswith(f"{key}=")]


def verified(unit, folder):
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("systemd-analyze is not on this machine")
    path = folder / "telerobot-unit.service"
    path.write_text(unit)
    found = subprocess.run(
        [analyze, "verify", str(path)], capture_output=True, text=True, check=False
    )
    return found.returncode, found.stderr


@pytest.mark.parametrize("cell", ["pa10", "pa10_pair"])
def test_systemd_takes_the_unit_of_a_shipped_cell(printed, tmp_path, cell):
    assert verified(printed(cell), tmp_path) == (0, "")


def test_systemd_takes_the_unit_of_a_cell_in_a_folder_of_any_name(printed, real, tmp_path):
    assert verified(printed(str(real), "--user", "root", "--cpus", "0-1"), tmp_path) == (0, "")


def test_its_command_serves_the_cell(printed, real):
    (line,) = lines(printed(str(real)), "ExecStart")
    assert not set("%$") & set(re.sub(r"%%|\$\$", "", line))
    words = [w.replace("%%", "%").replace("$$", "$") for w in shlex.split(line)]
    serve = next(command for command in COMMANDS if command.name == "serve")
    args = build_parser((serve,)).parse_args(words[words.index("serve") :])
    assert (args.command, args.cell) == ("serve", str(real))


def test_it_waits_for_the_interfaces_of_its_buses(printed, real):
    unit = printed(str(real))
    assert "sys-subsystem-net-devices-can0.device" in lines(unit, "After")
    assert lines(unit, "DeviceAllow") == ["/dev/cpu_dma_latency rw"]
    real.write_text(real.read_text().replace("socketcan", "slcan").replace("can0", "/dev/ttyACM0"))
    assert lines(printed(str(real)), "DeviceAllow") == []


def test_it_runs_as_a_user_of_its_own_with_real_time_and_is_restarted(printed):
    unit = printed("pa10", "--user", "robot", "--cpus", "3")
    assert lines(unit, "User") == ["robot"]
    assert lines(unit, "CPUAffinity") == ["3"]
    assert lines(unit, "LimitRTPRIO") == ["60"]
    assert lines(unit, "Restart") == ["on-failure"]
    assert lines(unit, "CPUSchedulingPolicy") == []
    assert lines(unit, "CapabilityBoundingSet") == [""]
    assert lines(unit, "NoNewPrivileges") == ["yes"]


def test_isolated_processors_are_taken_unless_others_are_said(printed, monkeypatch, tmp_path):
    from telerobot.tools.commands import service

    isolated = tmp_path / "isolated"
    isolated.write_text("2-3\n")
    monkeypatch.setattr(service, "ISOLATED", isolated)
    assert lines(printed("pa10"), "CPUAffinity") == ["2-3"]
    assert lines(printed("pa10", "--cpus", "1"), "CPUAffinity") == ["1"]
    isolated.write_text("\n")
    assert lines(printed("pa10"), "CPUAffinity") == []


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["pa10", "--user", "a b"], "no name of a user"),
        (["pa10", "--user", "x\nExecStart=/bin/sh"], "no name of a user"),
        (["pa10", "--cpus", "all"], "a list such as 3 or 2-3"),
        (["nowhere"], "nowhere"),
    ],
)
def test_what_would_spoil_the_unit_is_refused_in_one_line(capsys, argv, words):
    assert main(["service", *argv]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line


def test_text_of_a_cell_begins_no_line_of_the_unit(printed, real):
    real.write_text(real.read_text().replace("100 % steel", "a\\nExecStart=/bin/sh"))
    assert len(lines(printed(str(real)), "ExecStart")) == 1
