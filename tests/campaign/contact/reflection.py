"""Part `reflection`: both modes of force reflection over networks, protected and not."""

from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

from telerobot.config.load import ConfigError, load_cell

from ..part import Part, Selection
from .reflection_trial import Mode, ReflectionTrial, trial

CELL: Final = "pa10_reflect"
ROUND_TRIPS_S: Final = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5)
PROMISED: Final = (100.0, 150.0)
"""Reflected stiffness in pose mode that must settle at every delay [N/m]."""
SOUGHT: Final = (200.0, 250.0)
"""Beyond, to see up to where it does [N/m]."""


class ReflectionJob(NamedTuple):
    """One trial to play."""

    mode: Mode
    rtt_s: float
    protected: bool
    stiffness: float


class ReflectionOutcome(NamedTuple):
    """A trial, and whether its promises are kept is what counts."""

    trial: ReflectionTrial
    promised: bool

    @property
    def name(self) -> str:
        """The run, in a few words."""
        t = self.trial
        how = "" if t.protected else ", unprotected"
        what = t.mode if t.mode == "rate" else f"pose {t.stiffness:g} N/m"
        return f"{what} at {t.rtt_s * 1e3:g} ms{how}"

    @property
    def reasons(self) -> list[str]:
        """Broken promises; empty for a trial without protection."""
        return list(self.trial.faults) if self.promised else []


class ReflectionTable:
    """The reflection table: a row for each figure, a column for each round trip."""

    def __init__(self, played: Sequence[ReflectionOutcome]) -> None:
        self._played = played

    @property
    def kept(self) -> bool:
        """True when protected ones keep their promises, and unprotected ones show why."""
        without = (self._first_failing("rate", 0.0), self._first_failing("pose", PROMISED[0]))
        return not any(p.reasons for p in self._played) and None not in without

    @property
    def settles_up_to(self) -> float:
        """Greatest stiffness up to which every stiffness settled at every delay [N/m]."""
        found = 0.0
        for stiffness in (*PROMISED, *SOUGHT):
            if any(t.faults for t in self._row("pose", True, stiffness)):
                break
            found = stiffness
        return found

    def figures(self) -> dict[str, object]:
        """Return everything as plain values, for JSON."""
        return {
            "kept": self.kept,
            "settles_up_to": self.settles_up_to,
            "trials": [p.trial.figures() for p in self._played],
        }

    def lines(self) -> list[str]:
        """Return the table for people."""
        lines = [
            f"cell {CELL}: wall of 20 kN/m, 20 % jitter, 5 % loss; * breaks a promise",
            _line("round trip [ms]", [f"{rtt * 1e3:g}" for rtt in ROUND_TRIPS_S]),
        ]
        lines += self._rate_lines(True)
        for stiffness in (*PROMISED, *SOUGHT):
            lines += self._pose_lines(True, stiffness)
        lines.append("with the protection off")
        lines += self._rate_lines(False)
        for stiffness in PROMISED:
            lines += self._pose_lines(False, stiffness)
        lines.append(f"pose mode settles at every delay up to {self.settles_up_to:g} N/m")
        lines += [self._without("rate", 0.0), *(self._without("pose", k) for k in PROMISED)]
        broken = [f"{p.name}: {reason}" for p in self._played for reason in p.reasons]
        return [*lines, *broken, "all promises kept" if self.kept else "promises broken"]

    def _without(self, mode: Mode, stiffness: float) -> str:
        what = mode if mode == "rate" else f"pose {stiffness:g} N/m"
        first = self._first_failing(mode, stiffness)
        if first is None:
            return f"unprotected, {what} fails nowhere: the protection shows nothing"
        return f"unprotected, {what} fails from {first.rtt_s * 1e3:g} ms: {', '.join(first.faults)}"

    def _rate_lines(self, protected: bool) -> Iterator[str]:
        row = self._row("rate", protected, 0.0)
        yield _figures("rate: ripple [%]", row, lambda t: f"{100 * t.ripple:.0f}")
        yield _figures("  mean error [%]", row, lambda t: f"{100 * t.mean_error:+.1f}")
        yield _figures("  peak [N]", row, lambda t: f"{t.peak_n:.1f}")
        yield _figures("  release [s]", row, lambda t: f"{t.release_s:.2f}")

    def _pose_lines(self, protected: bool, stiffness: float) -> Iterator[str]:
        row = self._row("pose", protected, stiffness)
        yield _figures(
            f"pose {stiffness:g} N/m: ripple [%]", row, lambda t: f"{100 * t.ripple:.0f}"
        )
        yield _figures("  least energy [J]", row, lambda t: f"{t.least_energy_j:.3f}")
        yield _figures("  drift [mm]", row, lambda t: f"{1e3 * t.drift_m:.1f}")

    def _row(self, mode: Mode, protected: bool, stiffness: float) -> list[ReflectionTrial]:
        return [
            t
            for t in (p.trial for p in self._played)
            if t.mode == mode
            and t.protected == protected
            and (mode == "rate" or t.stiffness == stiffness)
        ]

    def _first_failing(self, mode: Mode, stiffness: float) -> ReflectionTrial | None:
        return next((t for t in self._row(mode, False, stiffness) if t.faults), None)


def _figures(name: str, row: list[ReflectionTrial], shown: Callable[[ReflectionTrial], str]) -> str:
    return _line(name, [shown(t) + ("*" if t.faults else "") for t in row])


def _line(name: str, values: list[str]) -> str:
    return f"{name:24}" + "".join(f"{value:>8}" for value in values)


def _jobs(_selection: Selection) -> list[ReflectionJob]:
    if load_cell(CELL).config.reflection is None:
        raise ConfigError(f"{CELL}: reflection: missing: there is nothing to judge")
    rows = [("rate", True, PROMISED[0]), ("rate", False, PROMISED[0])]
    rows += [("pose", True, k) for k in (*PROMISED, *SOUGHT)]
    rows += [("pose", False, k) for k in PROMISED]
    return [
        ReflectionJob("rate" if mode == "rate" else "pose", rtt_s, protected, stiffness)
        for mode, protected, stiffness in rows
        for rtt_s in ROUND_TRIPS_S
    ]


def _play(job: ReflectionJob) -> ReflectionOutcome:
    found = trial(load_cell(CELL), job.mode, job.rtt_s, job.protected, job.stiffness)
    return ReflectionOutcome(
        found, job.protected and (job.mode == "rate" or job.stiffness in PROMISED)
    )


REFLECTION = Part(_jobs, _play, ReflectionTable)
