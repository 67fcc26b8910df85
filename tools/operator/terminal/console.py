"""Terminal of an operator: keys one by one, scrolling lines, a status line below.

Left as it was found, whatever ends the program: leaving the context restores it, and SIGINT,
SIGTERM and SIGHUP only set `ended`, so that the program leaves in order. What is told after that
is not shown: a reply may come while the lease is given back.
"""

import os
import select
import shutil
import signal
import sys
import termios
import textwrap
from types import FrameType, TracebackType
from typing import Self

from ....config.errors import printable

_HIDE_CURSOR, _SHOW_CURSOR = "\x1b[?25l", "\x1b[?25h"
_CLEAR_BELOW = "\x1b[J"
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def is_terminal() -> bool:
    """Return whether a person sits at both ends: keys can be read and lines redrawn."""
    return sys.stdin.isatty() and sys.stdout.isatty()


class Console:
    """A terminal in raw mode, with a status of a few lines at the bottom; a context manager."""

    def __init__(self) -> None:
        self.ended = False
        """True once a signal, or the terminal's end, asks to leave."""
        self._status: list[str] = []
        self._shown = False
        self._fd = sys.stdin.fileno()

    def __enter__(self) -> Self:
        self._found = termios.tcgetattr(self._fd)
        self._handlers = {number: signal.signal(number, self._on_signal) for number in _SIGNALS}
        raw = termios.tcgetattr(self._fd)
        # No echo and no lines; ^Z and ^S would silence an operator in the middle of a motion.
        raw[0] &= ~(termios.IXON | termios.ICRNL)
        raw[3] &= ~(termios.ECHO | termios.ICANON | termios.IEXTEN)
        raw[6][termios.VSUSP] = b"\x00"
        raw[6][termios.VMIN], raw[6][termios.VTIME] = 1, 0
        termios.tcsetattr(self._fd, termios.TCSADRAIN, raw)
        self._shown = True
        self._write(_HIDE_CURSOR)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self._write(("\n" if self._status else "") + _SHOW_CURSOR)
        finally:
            self._shown = False
            termios.tcsetattr(self._fd, termios.TCSADRAIN, self._found)
            for number, handler in self._handlers.items():
                signal.signal(number, handler)

    def read(self, wait_s: float) -> bytes:
        """Return what was typed, waiting for it a while; nothing if nothing was."""
        try:
            ready, _, _ = select.select([self._fd], [], [], wait_s)
            data = os.read(self._fd, 1024) if ready else b""
        except OSError:
            ready, data = [self._fd], b""  # the terminal is gone: the same as its end
        if ready and not data:
            self.ended = True
        return data

    def say(self, line: str) -> None:
        """Print a line above the status, whoever worded it."""
        self._write(self._erase() + printable(line) + "\r\n" + self._draw())

    def show(self, *lines: str) -> None:
        """Redraw the status with these lines, each folded to the terminal's width."""
        erase = self._erase()
        width = max(shutil.get_terminal_size().columns - 1, 20)
        self._status = [part for line in lines for part in textwrap.wrap(printable(line), width)]
        self._write(erase + self._draw())

    def _erase(self) -> str:
        up = len(self._status) - 1
        return "\r" + (f"\x1b[{up}A" if up > 0 else "") + _CLEAR_BELOW

    def _draw(self) -> str:
        return "\r\n".join(self._status)

    def _write(self, text: str) -> None:
        if not self._shown:
            return
        try:
            sys.stdout.write(text)
            sys.stdout.flush()
        except OSError:
            self.ended = True  # nobody reads any more

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.ended = True
