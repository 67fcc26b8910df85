"""Progress is for terminals: what is read from a pipe has none of it."""

from telerobot.tools.host import progress
from telerobot.tools.host.progress import counted, say, sparing


class Terminal:
    encoding = "utf-8"

    def __init__(self):
        self.text = ""

    def isatty(self):
        return True

    def write(self, text):
        self.text += text

    def flush(self):
        pass


def test_items_pass_through_and_a_terminal_sees_how_many(monkeypatch, capsys):
    assert list(counted(iter("abc"), "read", "letters")) == ["a", "b", "c"]
    assert capsys.readouterr().err == ""
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setattr(progress, "SHOWN_AFTER_S", 0.0)
    assert list(counted(iter("abc"), "read", "letters")) == ["a", "b", "c"]
    assert "read: " in terminal.text
    assert "letters" in terminal.text


def test_a_flood_of_refused_faults_is_a_line_a_second():
    now, lines = [0.0], []
    tell = sparing(1.0, lines.append, lambda: now[0])
    for k in range(3000):
        now[0] = 0.001 * k
        tell(f"fault refused: fault push: no target 'x{k}'")
    assert lines == [
        "telerobot: fault refused: fault push: no target 'x0'",
        "telerobot: fault refused: fault push: no target 'x1000' (and 999 more before)",
        "telerobot: fault refused: fault push: no target 'x2000' (and 999 more before)",
    ]


def test_what_others_worded_takes_no_hold_of_the_terminal(capsys):
    say("asked by \x1b]0;mine\x07")
    assert capsys.readouterr().err.strip().isprintable()
