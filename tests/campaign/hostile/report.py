"""Report of a campaign: its three promises, and every run that broke one."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict

from .verdict import Verdict

LIMITED_SHARE = 0.3
"""Least part of all ticks with an active limit: the campaign is hostile enough [1]."""
REACHED_SHARE = 0.99
"""At least this part of the feasible goals is reached [1]."""


class Report:
    """The figures of a campaign's runs."""

    def __init__(self, verdicts: Sequence[Verdict]) -> None:
        self.verdicts = verdicts
        counted = [v for v in verdicts if v.counts]
        self.violations = sum(v.limit_violations for v in verdicts)
        self.unexpected = sum(bool(v.unexpected or v.failure) for v in verdicts)
        self.ticks = sum(v.ticks for v in verdicts)
        self.limited_share = sum(v.limited_ticks for v in verdicts) / max(1, self.ticks)
        self.feasible = len(counted)
        self.reached = sum(v.reached for v in counted)

    @property
    def reached_share(self) -> float:
        """Part of the feasible goals that was reached; 0 where there was none [1]."""
        return self.reached / self.feasible if self.feasible else 0.0

    @property
    def promises(self) -> dict[str, bool]:
        """Which promise holds."""
        return {
            "no_limit_violated": self.violations == 0 and self.unexpected == 0,
            "hostile_enough": self.limited_share >= LIMITED_SHARE,
            "goals_reached": self.reached_share >= REACHED_SHARE,
        }

    @property
    def kept(self) -> bool:
        """True when all promises hold."""
        return all(self.promises.values())

    def figures(self) -> dict[str, object]:
        """Return everything as plain values, for JSON."""
        return {
            "promises": self.promises,
            "runs": len(self.verdicts),
            "ticks": self.ticks,
            "limit_violations": self.violations,
            "unexpected": self.unexpected,
            "limited_share": self.limited_share,
            "limits": self._limits(),
            "goals_feasible": self.feasible,
            "goals_reached": self.reached,
            "reached_share": self.reached_share,
            "goals_infeasible": sum(bool(v.infeasible) for v in self.verdicts),
            "touched": sum(v.touched for v in self.verdicts),
            "max_speed_ratio": self._worst("max_speed_ratio"),
            "max_acceleration_ratio": self._worst("max_acceleration_ratio"),
            "tick_us_p50": self._worst("tick_us_p50"),
            "tick_us_p99": self._worst("tick_us_p99"),
            "failing": [
                {"cell": v.cell, "seed": v.seed, "reasons": v.reasons}
                for v in self.verdicts
                if v.reasons
            ],
            "by_run": [asdict(v) | {"counts": v.counts} for v in self.verdicts],
        }

    def lines(self) -> list[str]:
        """Return the report for people."""
        limits = ", ".join(
            f"{name} {n / max(1, self.ticks):.1%}" for name, n in self._limits().items()
        )
        shown = {
            "runs": f"{len(self.verdicts)}, {self.ticks} ticks",
            "limit violations": f"{self.violations}, must be 0",
            "unexpected faults": f"{self.unexpected} runs, must be 0",
            "limited ticks": f"{self.limited_share:.1%}, at least {LIMITED_SHARE:.0%} ({limits})",
            "goals reached": f"{self.reached} of {self.feasible} feasible, "
            f"{self.reached_share:.1%}, at least {REACHED_SHARE:.0%}",
            "not counted": f"{sum(bool(v.infeasible) for v in self.verdicts)} infeasible, "
            f"{sum(v.touched and not v.infeasible for v in self.verdicts)} hit something",
            "worst ratios": f"speed {self._worst('max_speed_ratio'):.4f}, "
            f"acceleration {self._worst('max_acceleration_ratio'):.4f}",
            "worst tick": f"p50 {self._worst('tick_us_p50'):.0f} µs, "
            f"p99 {self._worst('tick_us_p99'):.0f} µs",
        }
        lines = [f"{name:20} {text}" for name, text in shown.items()]
        for v in self.verdicts:
            again = (
                f"python -m laboratory.campaign --only hostile --cells {v.cell} --seeds {v.seed}"
            )
            lines += [f"{again}  # {reason}" for reason in v.reasons]
        broken = [name for name, kept in self.promises.items() if not kept]
        lines.append("all promises kept" if self.kept else f"broken: {', '.join(broken)}")
        return lines

    def _limits(self) -> dict[str, int]:
        total: Counter[str] = Counter()
        for v in self.verdicts:
            total.update(v.limits)
        return dict(total.most_common())

    def _worst(self, name: str) -> float:
        return max((float(getattr(v, name)) for v in self.verdicts), default=math.nan)
