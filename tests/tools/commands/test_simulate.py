import gc
import json

import pytest
from telerobot.tools.cli import main


def refused(argv, capsys, caplog):
    """Run a command that a user got wrong; return its code and its only line."""
    gc.collect()  # buses of other tests complain now
    caplog.clear()
    code = main(argv)
    gc.collect()  # a bus that was left open would complain now
    assert caplog.records == []
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return code, err


@pytest.mark.parametrize("command", [["simulate"], ["demo", "--headless"]])
def test_a_cell_without_virtual_hardware_is_named(command, small, capsys, caplog):
    text = small.cell.read_text()
    small.cell.write_text(text[: text.index("[rig.drive]")])
    code, line = refused([*command, str(small.cell)], capsys, caplog)
    assert code == 2
    assert line.startswith(f"telerobot: {small.cell}: rig: missing")


def test_a_fault_that_makes_no_sense_fails_the_script(small, capsys, tmp_path):
    script = tmp_path / "script.toml"
    script.write_text(
        "duration_s = 1.0\n[[step]]\nat_s = 0.1\n"
        "'rig/fault' = { kind = 'silence', target = 'nosuch' }"
    )
    assert main(["simulate", str(small.cell), str(script), "--json"]) == 1
    failure = json.loads(capsys.readouterr().out)["failure"]
    assert failure.startswith("0.1 s: fault silence: no target 'nosuch'")


def test_a_recording_that_cannot_be_written_is_named(small, capsys, caplog):
    nowhere = "/nowhere/run.mcap"
    code, line = refused(["simulate", str(small.cell), "--record", nowhere], capsys, caplog)
    assert code == 1
    assert nowhere in line
