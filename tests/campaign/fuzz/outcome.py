"""The result of one fuzzing job, and the report on all of them."""

import traceback
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field


@dataclass
class Outcome:
    """Result of one job: counts of inputs by kind, and broken promises."""

    what: str
    seed: int
    inputs: Counter[str] = field(default_factory=Counter)
    reasons: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Kind of inputs, and seed."""
        return f"{self.what} seed {self.seed}"

    def raised(self, error: BaseException, what: str) -> str:
        """Return the words on an exception that something raised which had to refuse by name."""
        frame = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{frame.filename.rpartition('/')[2]}:{frame.lineno}"
        words = f"{type(error).__name__}: {error}".splitlines()[0][:120]
        return f"{what[:200]}: {where} raised {words}"


@dataclass(frozen=True)
class Endurance:
    """Summary of all fuzzing jobs."""

    outcomes: Sequence[Outcome]

    @property
    def kept(self) -> bool:
        """True when nothing was raised, no bound was broken and no arm was in FAULT."""
        return not any(outcome.reasons for outcome in self.outcomes)

    def figures(self) -> dict[str, object]:
        """Return everything as plain values."""
        total: Counter[str] = Counter()
        for outcome in self.outcomes:
            total.update(outcome.inputs)
        return {
            "inputs": total.total(),
            "by_kind": dict(sorted(total.items())),
            "failing": [
                {"what": o.what, "seed": o.seed, "reasons": o.reasons}
                for o in self.outcomes
                if o.reasons
            ],
        }

    def lines(self) -> list[str]:
        """Return the report."""
        total: Counter[str] = Counter()
        for outcome in self.outcomes:
            total.update(outcome.inputs)
        lines = [f"inputs {total.total()}: " + ", ".join(f"{k} {n}" for k, n in total.items())]
        for outcome in self.outcomes:
            again = f"python -m laboratory.campaign --only fuzz --seeds {outcome.seed}"
            lines += [f"{again}  # {outcome.what}: {reason}" for reason in outcome.reasons[:5]]
        lines.append("all refused by name, nothing raised" if self.kept else "promises broken")
        return lines
