"""The report of a part whose runs are each judged on their own: its promise is that none fails."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from .part import JobResult

R = TypeVar("R", bound=JobResult)


@dataclass(frozen=True)
class Runs(Generic[R]):
    """Summary of all runs; a part adds its own figures and lines."""

    runs: Sequence[R]

    @property
    def kept(self) -> bool:
        """True when nothing speaks against any run."""
        return not self.failing

    @property
    def failing(self) -> dict[str, list[str]]:
        """Reasons against each run that there are any against."""
        return {run.name: run.reasons for run in self.runs if run.reasons}

    def figures(self) -> dict[str, object]:
        """Return everything as plain values."""
        return {"runs": len(self.runs), "failing": self.failing}

    def lines(self) -> list[str]:
        """Return the report: a line for each thing that speaks against a run."""
        return [f"{name}: {reason}" for name, why in self.failing.items() for reason in why]
