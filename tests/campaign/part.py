"""Contract of a campaign's part: its jobs, the play of one, the summary of all.

Jobs and results cross processes, so both are plain, picklable values; `play` is a function of a
module. A part is one more file, and one more line in `parts.py`.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol


class Selection(NamedTuple):
    """Choices of the command line."""

    cells: tuple[str, ...]
    """Names of cells, for parts that run in any cell."""
    seeds: range
    """Seeds, for parts that are drawn."""


class JobResult(Protocol):
    """The result of one job."""

    @property
    def name(self) -> str:
        """The run, in a few words."""

    @property
    def reasons(self) -> list[str]:
        """Broken promises; empty if all went well."""


class Summary(Protocol):
    """Summary of a part's results."""

    @property
    def kept(self) -> bool:
        """True when all promises hold."""

    def figures(self) -> dict[str, object]:
        """Return everything as plain values, for JSON."""

    def lines(self) -> list[str]:
        """Return the report for people."""


class Part(NamedTuple):
    """One part of the campaign."""

    jobs: Callable[[Selection], list[Any]]
    """Lists the jobs; raises `ConfigError` where a cell is wrong."""
    play: Callable[[Any], JobResult]
    report: Callable[[Sequence[Any]], Summary]
