"""Expectations of a script: what its run is to reach, judged by the figures of the simulation.

    [expect]
    mode = "enabled"
    tool_error_m = { most = 0.001 }
    contact_force_n = { least = 9.0, most = 11.0 }

Figures are the physics' own. Where a figure has several values (each peg's depth), all of them
count. A run that has no such figure has missed it.
"""

from collections.abc import Iterator, Mapping
from typing import Any, Literal, NamedTuple

from pydantic import model_validator

from .generators.tables import ScriptTable


class Bounds(ScriptTable):
    """Bounds of a figure, both of them inclusive; an absent one is open."""

    least: float | None = None
    most: float | None = None

    @model_validator(mode="after")
    def _bound_something(self) -> "Bounds":
        if self.least is None and self.most is None:
            raise ValueError("least or most is expected")
        if self.least is not None and self.most is not None and self.least > self.most:
            raise ValueError(f"least {self.least:g} is above most {self.most:g}")
        return self

    def hold(self, values: list[float]) -> bool:
        """Return whether there are values, and all are within."""
        least = -float("inf") if self.least is None else self.least
        most = float("inf") if self.most is None else self.most
        return bool(values) and all(least <= value <= most for value in values)

    def __str__(self) -> str:
        parts = [] if self.least is None else [f"at least {self.least:g}"]
        return " and ".join(parts if self.most is None else [*parts, f"at most {self.most:g}"])


class Expected(NamedTuple):
    """One expectation beside what was found; plain values, a row of the simulation's JSON."""

    figure: str
    expected: str
    found: Any
    """Value of the figure; None: it was not measured."""
    met: bool

    def __str__(self) -> str:
        return f"{self.figure}: {_shown(self.found)}, {self.expected} is expected"


class Expectations(ScriptTable):
    """What a run is to reach. Without a mode, it may end in any but FAULT."""

    mode: Literal["ready", "enabled", "hold", "fault"] | None = None
    """Mode at the end."""
    events: tuple[str, ...] = ()
    """Events that are to be told, by name, in any order."""
    refused: Bounds = Bounds(most=0)
    """Number of steps that the daemon refuses."""
    tool_error_m: Bounds | None = None
    tool_error_rad: Bounds | None = None
    """Of the tool from its target, the largest over the last half second."""
    posture_error_rad: Bounds | None = None
    """Of the farthest joint from the posture that was last asked for, at the end."""
    view_error_m: Bounds | None = None
    view_error_rad: Bounds | None = None
    """Of the Lens from the stored view, at the end."""
    contact_force_n: Bounds | None = None
    """Mean over the last second, as a sum of magnitudes over the solids that touch."""
    contact_peak_n: Bounds | None = None
    """The greatest such sum in any physics step."""
    own_contact_n: Bounds | None = None
    """The same of what arms and payload press on themselves and each other."""
    min_clearance_m: Bounds | None = None
    min_between_arms_m: Bounds | None = None
    min_sight_m: Bounds | None = None
    peg_depth_m: Bounds | None = None
    """How deep each peg is at the end."""
    internal_force_n: Bounds | None = None
    stretch_m: Bounds | None = None
    push_n: Bounds | None = None
    """Of a payload, and what the payload pushes with."""
    insertion_m: Bounds | None = None
    deepest_m: Bounds | None = None
    """How far the tip of a backbone is in along the centre line: at the end, and at most."""
    centre_error_m: Bounds | None = None
    wall_force_n: Bounds | None = None
    base_travel_m: Bounds | None = None
    odometry_error_m: Bounds | None = None
    odometry_error_rad: Bounds | None = None

    def ends_well(self, mode: str) -> bool:
        """Return whether a run may end in this mode."""
        return mode != "fault" if self.mode is None else mode == self.mode

    def judge(self, summary: Mapping[str, Any]) -> list[Expected]:
        """Return every expectation, beside what a simulation's summary shows."""
        mode = summary["mode"]
        wanted = "any but fault" if self.mode is None else self.mode
        told = {event["name"] for event in summary["events"]}
        rows = [Expected("mode", wanted, mode, self.ends_well(mode))]
        rows += [Expected("event", name, name in told, name in told) for name in self.events]
        return rows + list(self._figures(summary))

    def _figures(self, summary: Mapping[str, Any]) -> Iterator[Expected]:
        for name in type(self).model_fields:
            bounds = getattr(self, name)
            if isinstance(bounds, Bounds):
                found = len(summary[name]) if name == "refused" else summary.get(name)
                yield Expected(name, str(bounds), found, bounds.hold(_values(found)))


def _values(found: Any) -> list[float]:
    if found is None:
        return []
    if isinstance(found, Mapping):
        return list(found.values())
    return list(found) if isinstance(found, list | tuple) else [found]


def _shown(found: Any) -> str:
    if found is None:
        return "not measured"
    if isinstance(found, bool):
        return "told" if found else "not told"
    if isinstance(found, str):
        return found
    return ", ".join(f"{value:.4g}" for value in _values(found))
