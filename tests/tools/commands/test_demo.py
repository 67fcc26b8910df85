"""What a demo's processes and peers worded takes no hold of the terminal."""

import subprocess

from telerobot.tools.cli import main
from telerobot.tools.commands import demo
from telerobot.tools.host import local_plant

HOSTILE = "\x1b]0;mine\x07\x9b2J\u202eann"


def test_what_a_process_wrote_before_it_ended_is_told_in_printable_lines(monkeypatch, capsys):
    def ends(*_arguments, **streams):
        return subprocess.Popen(["printf", "%s\\n", f"by {HOSTILE}"], **streams)

    monkeypatch.setattr(local_plant, "_child", ends)
    monkeypatch.setattr(demo, "own_endpoint", lambda *_: (None, ""))
    assert main(["demo", "pa10", "--headless"]) == 1
    told = capsys.readouterr().err
    assert r"rig: by \u001b]0;mine\u0007" in told
    assert all(line.isprintable() for line in told.split("\n"))


def test_a_summary_is_printable_lines_whoever_worded_what_is_in_it():
    summary = dict.fromkeys(("rounds", "mode", "refused", "errors", "failure"), HOSTILE)
    assert all(line.isprintable() for line in demo.table(summary).split("\n"))
