"""Result of a simulation, and the figures of its JSON."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...protocols.messages.rig import RigTruth
from ...protocols.messages.telemetry import Event, State
from ..scripts.expectations import Expected

CONTACT_S = 1.0
"""The contact force is the mean over this long before the end [s]."""


@dataclass(frozen=True)
class Result:
    """Outcome of a simulation: the fields of its JSON, and the state of every tick."""

    summary: dict[str, object]
    states: tuple[State, ...]
    truths: tuple[RigTruth, ...]
    """The physics' truth after every tick."""
    expected: tuple[Expected, ...] = ()
    """What the script was to reach, beside what was found."""

    @property
    def ok(self) -> bool:
        """True when the script was played, met what it expects, and no limit was violated."""
        return (
            self.summary["failure"] is None
            and self.summary["limit_violations"] == 0
            and all(row.met for row in self.expected)
        )


def event_rows(events: Sequence[Event]) -> list[dict[str, object]]:
    """Return events as rows of JSON, `values` only where there are any."""
    return [
        {"t_s": e.time_s, "name": e.name, "severity": e.severity, "detail": e.detail}
        | ({"values": e.values} if e.values else {})
        for e in events
    ]


def least_clearance(truths: Sequence[RigTruth]) -> float | None:
    """Return the least distance between the arm and fixed things [m]; None without any."""
    return min((t.clearance_m for t in truths if t.clearance_m is not None), default=None)


def least_between_arms(truths: Sequence[RigTruth]) -> float | None:
    """Return the least distance between arms [m], at most 1; None for one arm alone."""
    return min((t.between_arms_m for t in truths if t.between_arms_m is not None), default=None)


def least_sight(truths: Sequence[RigTruth]) -> float | None:
    """Return the least distance between a link and a line of sight [m]; None without any."""
    return min((d for t in truths for of in t.sight.values() for d in of.values()), default=None)


def contact_force(truths: Sequence[RigTruth], period_s: float) -> float:
    """Return the mean contact force of the last `CONTACT_S`, of the arm that presses most [N]."""
    late = truths[-round(CONTACT_S / period_s) :]
    names = late[0].arms if late else ()
    sums = [math.fsum(truth.arms[name].contact_sum for truth in late) for name in names]
    return max(sums, default=0.0) / max(len(late), 1)


def contact_peak(truths: Sequence[RigTruth]) -> float:
    """Return the greatest contact force of an arm in any physics step [N]."""
    return max((arm.contact_peak for t in truths for arm in t.arms.values()), default=0.0)


def tick_times(compute_s: Sequence[float]) -> dict[str, float]:
    """Return quantiles of the tick's computing time [µs]."""
    micros = np.array(compute_s) * 1e6 if compute_s else np.zeros(1)
    return {
        "p50": round(float(np.percentile(micros, 50)), 1),
        "p99": round(float(np.percentile(micros, 99)), 1),
        "max": round(float(micros.max()), 1),
    }
