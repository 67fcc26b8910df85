import argparse
import re
import subprocess
import sys
from importlib.metadata import version

import pytest
from telerobot.config.errors import ConfigError
from telerobot.config.load import shipped
from telerobot.drivers.device import DeviceError
from telerobot.tools import cli
from telerobot.tools.cli import COMMANDS, main
from telerobot.tools.commands import check


def leave(argv):
    with pytest.raises(SystemExit) as caught:
        main(argv)
    return caught.value.code


def test_help_lists_every_command(capsys):
    assert leave(["--help"]) == 0
    out = capsys.readouterr().out
    for command in COMMANDS:
        assert re.search(rf"^ +{command.name}\s", out, re.M)


@pytest.mark.parametrize("name", ["check", "doctor"])
def test_a_commands_help_has_examples(name, capsys):
    assert leave([name, "--help"]) == 0
    assert f"examples:\n  telerobot {name}" in capsys.readouterr().out


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: c.name)
def test_examples_name_what_is_shipped(command):
    for example in command.examples:
        told = re.sub(r"--(user|cpus) \S+", "", example).split()[2:]
        words = [word for word in told if re.fullmatch("[a-z0-9_]+", word)]
        assert set(words) <= {*shipped("cells"), *shipped("scripts"), "bash"}


def test_version(capsys):
    assert leave(["--version"]) == 0
    assert capsys.readouterr().out == f"telerobot {version('telerobot')}\n"


def test_the_package_runs_as_the_command():
    ran = subprocess.run(
        [sys.executable, "-m", "telerobot", "--version"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert ran.stdout == f"telerobot {version('telerobot')}\n"


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        (["telerobot", "simu"], {"simulate"}),
        (["telerobot", "simulate", "pa10_p"], {"pa10_pair", "pa10_peg", "pa10_platform"}),
        (["telerobot", "simulate", "--re"], {"--record"}),
    ],
)
def test_bash_completes_commands_cells_and_options(typed, offered, capsys):
    assert main(["completion", "bash"]) == 0
    ask = f"COMP_WORDS=({' '.join(typed)}); COMP_CWORD={len(typed) - 1}; _shtab_telerobot"
    script = f"{capsys.readouterr().out}\n{ask}; printf '%s\n' \"${{COMPREPLY[@]}}\""
    ran = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert set(ran.stdout.split()) == offered


def test_no_command_shows_the_help_and_is_bad_usage(capsys):
    assert main([]) == 2
    assert "commands:" in capsys.readouterr().err


@pytest.mark.parametrize("argv", [["chekc"], ["check"], ["check", "pa10", "--yes"]])
def test_bad_usage_is_one_line_and_code_2(argv, capsys):
    assert leave(argv) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("telerobot")
    assert captured.err.count("\n") == 1


@pytest.mark.parametrize(
    ("argv", "bound"),
    [
        (["identify", "pa10", "--attitudes", "many"], "6 to 200 attitudes"),
        (["identify", "pa10", "--attitudes", "5"], "6 to 200 attitudes"),
        (["identify", "pa10", "--environment", "--force", "40"], "6 to 20 N"),
        (["doctor", "--seconds", "soon"], "0.01 to 600 seconds"),
        (["record", "pa10", "--split", "0.5"], "1 to 1000000 MB"),
        (["certify", "pa10", "--days", "3.5"], "1 to 3650 days"),
    ],
)
def test_a_number_that_is_none_or_beyond_is_told_with_its_bounds(argv, bound, capsys):
    assert leave(argv) == 2
    told = capsys.readouterr().err
    assert f"{argv[-1]!r}: must be from {bound}" in told
    assert argv[-2] in told


def test_a_bad_cell_is_a_line_for_each_mistake_and_code_2(small, capsys):
    assert main(["check", str(small.replace("node = 2", "node = 1"))]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"telerobot: {small.cell}: mechanism.drives[1].node: value 1: ")
    assert captured.err.count(f"{small.cell}: ") == captured.err.count("\n")


@pytest.mark.parametrize(
    ("trouble", "code", "words"),
    [
        (ConfigError("cell.toml: key: bad"), 2, "telerobot: cell.toml: key: bad\n"),
        (DeviceError("drive j1: no answer"), 1, "telerobot: drive j1: no answer\n"),
        (FileNotFoundError(2, "No such file", "x.mcap"), 1, "x.mcap"),
        (ModuleNotFoundError("No module named 'mujoco'"), 1, "'mujoco'"),
        (KeyboardInterrupt(), 130, ""),
    ],
)
def test_expected_trouble_is_a_line_and_a_code(monkeypatch, capsys, trouble, code, words):
    def run(args: argparse.Namespace) -> int:
        raise trouble

    monkeypatch.setattr(check, "run", run)
    assert main(["check", "pa10"]) == code
    captured = capsys.readouterr()
    assert words in captured.err
    assert captured.err.count("\n") == bool(words)


def test_a_command_that_cannot_be_imported_leaves_the_others_whole(monkeypatch, capsys):
    broken = cli.HelpRow("broken", "no_such_module", "never works", ())
    monkeypatch.setattr(cli, "COMMANDS", (broken, *COMMANDS))
    assert main(["broken"]) == 1
    assert "broken: cannot be loaded" in capsys.readouterr().err
    assert leave(["check", "--help"]) == 0


def loaded_by(*argvs):
    """Return the modules of a process that was asked for these lines of help."""
    code = (
        "import sys; from telerobot.tools.cli import main\n"
        f"for argv in {argvs}:\n"
        "    try: main(argv)\n"
        "    except SystemExit: pass\n"
        "print(*sys.modules, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.count("usage: telerobot") == len(argvs)
    return set(done.stderr.split())


def test_help_loads_none_of_the_heavy_libraries():
    heavy = {"numpy", "numba", "pinocchio", "mujoco", "zenoh", "can", "pydantic", "tqdm"}
    assert not heavy & loaded_by(["--help"])


def test_the_help_of_no_command_loads_compiler_models_or_physics():
    heavy = {
        "numpy",
        "numba",
        "pinocchio",
        "mujoco",
        "pydantic",
        "zenoh",
        "cryptography",
        "trimesh",
    }
    others = [[c.name, "--help"] for c in COMMANDS]
    assert not {*heavy, "mcap"} & loaded_by(*others)


def test_names_in_a_file_do_nothing_to_the_terminal(tmp_path, capsys):
    path = tmp_path / "cell.toml"
    path.write_text('extends = "pa10"\n"\\u001b]0;mine\\u0007\\u202e" = 1\n')
    assert main(["check", str(path)]) == 2
    told = capsys.readouterr().err
    assert r"\u001b]0;mine\u0007\u202e" in told
    assert told.removesuffix("\n").isprintable()
    assert leave(["check", "\x1b]0;mine\x07", "\x9b2J"]) == 2
    assert capsys.readouterr().err.removesuffix("\n").isprintable()
