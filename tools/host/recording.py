"""A recorder beside a cell's daemon, as a process of its own."""

import subprocess
import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from types import TracebackType
from typing import Self

from ...config.load import Cell
from .address import options
from .local_plant import CLI, end, end_with_parent


class LiveRecording:
    """Records a cell into a folder while it is open; a context manager."""

    def __init__(self, cell: Cell, folder: Path) -> None:
        self._command = [sys.executable, "-m", CLI, "record", *options(cell), f"--out={folder}"]
        self._child: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        self._child = subprocess.Popen(
            self._command,
            stdin=subprocess.DEVNULL,
            start_new_session=True,  # a ^C at the terminal is ours to pass on, in order
            preexec_fn=end_with_parent,  # noqa: PLW1509  one system call, takes no lock
        )
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._child is not None:
            end(self._child)


def recording(cell: Cell, folder: Path | None) -> AbstractContextManager[object]:
    """Return what records a cell into a folder; for None, what does not."""
    return nullcontext() if folder is None else LiveRecording(cell, folder)
