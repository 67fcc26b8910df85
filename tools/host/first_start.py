"""Progress of a first start: kernels are compiled once for a machine, which takes minutes."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final, TextIO

from ...server.control import compilation

if TYPE_CHECKING:
    from tqdm import tqdm

QUIET_S: Final = 2.0  # compiling that takes no longer is not told [s]

WORDS: Final = "telerobot: compiling kernels for this machine, once"


@contextmanager
def told(to: TextIO | None = None) -> Iterator[None]:
    """Tell of kernels that are compiled in here: on a terminal by a bar, else that it began."""
    news = _CompileNotice(sys.stderr if to is None else to)
    compilation.listeners.append(news)
    try:
        yield
    finally:
        compilation.listeners.remove(news)
        news.close()


def kernels() -> int:
    """Return how many kernels the package has; no command needs more."""
    root = Path(compilation.__file__).resolve().parents[2]
    files = (file for room in ("server", "drivers") for file in (root / room).rglob("*.py"))
    return sum(file.read_text(encoding="utf-8").count("\n@compiled(") for file in files)


class _CompileNotice:
    """One line for all kernels; `to` is a terminal or a file."""

    def __init__(self, to: TextIO) -> None:
        self._to = to
        self._began_s: float | None = None
        self._count = 0
        self._said = False
        self._bar: tqdm[None] | None = None

    def __call__(self, name: str) -> None:
        now = time.monotonic()
        if self._began_s is None:
            self._began_s = now
        self._count += 1
        if now - self._began_s < QUIET_S:
            return
        if self._to.isatty():
            if self._bar is None:
                from tqdm import tqdm  # only for who waits

                most = max(kernels(), self._count)
                self._bar = tqdm(desc=WORDS, total=most, unit=" kernels", file=self._to)
                self._bar.start_t -= now - self._began_s
            self._bar.total = max(self._bar.total or 0, self._count)
            self._bar.n = self._count
            self._bar.set_postfix_str(name)
        elif not self._said:
            print(f"{WORDS}; it takes minutes", file=self._to, flush=True)
            self._said = True

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()
