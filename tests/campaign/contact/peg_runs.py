"""Part `peg`: every direction, with and without force control, at two physics steps."""

from collections.abc import Sequence
from dataclasses import asdict
from statistics import median

from ..part import Part, Selection
from .insertion import (
    DEEP,
    DIRECTIONS,
    GENTLE,
    ROUGH,
    SQUEEZED,
    WITHIN_S,
    Attempt,
    PegInsertion,
    attempt,
    cell_of,
)

PARTS_OF_STEP = (1, 2)
"""The cell's physics step, and half of it."""


class PegReport:
    """The figures of all attempts."""

    def __init__(self, insertions: Sequence[PegInsertion]) -> None:
        self.insertions = insertions

    @property
    def promises(self) -> dict[str, bool]:
        """Which promise holds."""
        return {
            "force_control_inserts": all(i.inserted for i in self._of(stiff=False)),
            "same_at_half_the_step": all(
                len({i.inserted for i in self._of(stiff=False) if i.direction == d}) == 1
                for d in range(DIRECTIONS)
            ),
            "stiff_is_rough_or_fails": all(i.rough for i in self._of(stiff=True)),
            "no_limit_violated": all(i.limit_violations == 0 for i in self.insertions),
        }

    @property
    def kept(self) -> bool:
        """True when all promises hold."""
        return bool(self.insertions) and all(self.promises.values())

    def figures(self) -> dict[str, object]:
        """Return everything as plain values, for JSON."""
        return {"promises": self.promises, "by_run": [asdict(i) for i in self.insertions]}

    def lines(self) -> list[str]:
        """Return a table of all directions, then what they come to."""
        columns = [(stiff, part) for stiff in (False, True) for part in PARTS_OF_STEP]
        head = [f"{'stiff' if s else 'force'}, step 1/{p}" for s, p in columns]
        found = {(i.direction, i.stiff, i.part): i for i in self.insertions}
        lines = ["direction  " + "".join(f"{text:36}" for text in head).rstrip()]
        for d in range(DIRECTIONS):
            cells = [found.get((d, *column)) for column in columns]
            words = ["-" if i is None else i.words for i in cells]
            lines.append(f"{d:9d}  " + "".join(f"{word:36}" for word in words).rstrip())
        for stiff, bound in (
            (
                False,
                f"to {1e3 * DEEP:g} mm within {WITHIN_S:g} s below {GENTLE:g} N net and "
                f"{SQUEEZED:g} N in all",
            ),
            (True, f"at least one of {ROUGH:g} N exceeded, not {1e3 * DEEP:g} mm deep, a fault"),
        ):
            some = self._of(stiff)
            if not some:
                continue
            good = sum(i.rough if stiff else i.inserted for i in some)
            peaks = [i.peak_n for i in some]
            lines.append(
                f"{'stiff' if stiff else 'force'}: {good} of {len(some)} {bound}; peak "
                f"{min(peaks):.1f} to {max(peaks):.1f} N, median {median(peaks):.1f} N"
            )
        lines += [f"{i.name}: {reason}" for i in self.insertions for reason in i.reasons]
        broken = [name for name, kept in self.promises.items() if not kept]
        lines.append("all promises kept" if self.kept else f"broken: {', '.join(broken)}")
        return lines

    def _of(self, stiff: bool) -> list[PegInsertion]:
        return [i for i in self.insertions if i.stiff is stiff]


def _jobs(selection: Selection) -> list[Attempt]:
    attempts = [
        Attempt(direction, stiff, part)
        for direction in range(DIRECTIONS)
        for stiff in (False, True)
        for part in PARTS_OF_STEP
    ]
    cell_of(attempts[0])  # a mistake in the cell shows here, in one line
    return attempts


PEG = Part(_jobs, attempt, PegReport)
