"""Progress of a first start: kernels are compiled once for a machine, which takes minutes."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, TextIO

from ...server.control import compilation

QUIET_S: Final = 2.0
"""Compiling that takes no longer is not told [s]."""


@contextmanager
def told(to: TextIO | None = None) -> Iterator[None]:
    """Tell of kernels that are compiled in here: on a terminal each, else that it began."""
    news = _CompileNotice(sys.stderr if to is None else to)
    compilation.listeners.append(news)
    try:
        yield
    finally:
        compilation.listeners.remove(news)
        news.close()


class _CompileNotice:
    """One line for all kernels; `to` is a terminal or a file."""

    def __init__(self, to: TextIO) -> None:
        self._to = to
        self._began_s: float | None = None
        self._count = 0
        self._shown = False

    def __call__(self, name: str) -> None:
        now = time.monotonic()
        if self._began_s is None:
            self._began_s = now
        self._count += 1
        if now - self._began_s < QUIET_S:
            return
        words = "telerobot: compiling kernels for this machine, once; it takes minutes"
        if self._to.isatty():
            print(f"\r{words}: {self._count} {name}\x1b[K", end="", file=self._to, flush=True)
        elif not self._shown:
            print(words, file=self._to, flush=True)
        self._shown = True

    def close(self) -> None:
        """End the line."""
        if self._shown and self._to.isatty():
            print(file=self._to, flush=True)
