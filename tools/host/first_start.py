"""A first start: kernels are compiled once for a machine, on all its processors, with progress.

`python -m telerobot.tools.host.first_start` compiles all that are not on disk.
"""

import fcntl
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Final, TextIO

from ...server.control import compilation

if TYPE_CHECKING:
    from tqdm import tqdm

QUIET_S: Final = 2.0
"""Compiling that takes no longer is not told, nor helped with [s]."""

WORDS: Final = "telerobot: compiling kernels for this machine, once"

PACKAGE: Final = __package__.partition(".")[0]

_LINES: Final = "--lines"


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


def _with_kernels() -> dict[str, int]:
    """Return how many kernels each module of the package has that has any."""
    root, found = Path(compilation.__file__).resolve().parents[2], {}
    for room in ("server", "drivers"):
        for file in sorted((root / room).rglob("*.py")):
            count = file.read_text(encoding="utf-8").count("\n@compiled(")
            if count:
                found[".".join((PACKAGE, *file.relative_to(root).with_suffix("").parts))] = count
    return found


def kernels() -> int:
    """Return how many kernels the package has; no command needs more."""
    return sum(_with_kernels().values())


class _CompileNotice:
    """One line for all kernels; `to` is a terminal or a file."""

    def __init__(self, to: TextIO, *, helped: bool = False) -> None:
        self._to, self._helped = to, helped
        self._began_s: float | None = None
        self._count = 0
        self._said = False
        self._bar: tqdm[None] | None = None

    def __call__(self, module: str, name: str, left: int) -> None:
        now = time.monotonic()
        if self._began_s is None:
            self._began_s = now
        self._count += 1
        if now - self._began_s < QUIET_S:
            return
        self._tell(name, left)
        # One by one is quicker for those few that a command calls.
        if left and module.startswith(f"{PACKAGE}.") and not self._helped:
            self._helped = True
            for helped in _compile_all():
                self._count += 1
                self._tell(helped, left)

    def _tell(self, name: str, left: int) -> None:
        if self._to.isatty():
            if self._bar is None:
                from tqdm import tqdm  # only for who waits

                self._bar = tqdm(desc=WORDS, unit=" kernels", file=self._to)
                self._bar.start_t -= time.monotonic() - (self._began_s or 0.0)
            if left:
                self._bar.total = max(kernels(), self._count)
            self._bar.n = self._count
            self._bar.set_postfix_str(name)
        elif not self._said:
            print(WORDS + ("; it takes a minute" if left else ""), file=self._to, flush=True)
            self._said = True

    def close(self) -> None:
        """End the line."""
        if self._bar is not None:
            self._bar.close()


# --- All kernels at once, on all processors: in a process of its own, which loads all and forks ---


def _compile_all() -> Iterator[str]:
    """Have all kernels compiled to disk; yield the module of each as it is there.

    Whoever asks compiles what is missing then by himself, and meets what was in the way.
    """
    command = [sys.executable, "-m", f"{__package__}.first_start", _LINES]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        yield from (line.strip() for line in process.stdout or ())


def _compiled() -> Iterator[str]:
    """Compile all kernels; yield the module of each that was not on disk."""
    modules = _with_kernels()
    for module in modules:
        import_module(module)
    # Those who start at the same time need the same kernels: one compiles, the others find them.
    with Path(compilation.__file__).open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        longest = sorted(modules, key=lambda module: -modules[module])
        with multiprocessing.get_context("fork").Pool(len(os.sched_getaffinity(0))) as pool:
            for module, count in pool.imap_unordered(_make, longest):
                yield from [module] * count


def _make(module: str) -> tuple[str, int]:
    """Make the kernels of a module; return it, and how many were compiled."""
    return module, sum(make(0) for make in compilation.makers[module])


def _main() -> None:
    """Tell what is compiled: in lines to who helps himself by it, else as `told` does."""
    news = _CompileNotice(sys.stderr, helped=True)
    for module in _compiled():
        if _LINES in sys.argv:
            print(module, flush=True)
        else:
            news(module, module, 1)
    news.close()


if __name__ == "__main__":
    _main()
