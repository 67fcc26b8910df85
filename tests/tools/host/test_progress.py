"""Progress is for terminals: what is read from a pipe has none of it."""

from telerobot.tools.host import progress
from telerobot.tools.host.progress import counted


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
