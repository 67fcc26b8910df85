"""Panels of a run over time, as in the papers."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes

from .grasps import internal_force
from .reader import RecordedRun

NAMED_LINKS = 4
"""Number of closest links drawn in colour and named [1]."""


def distances(run: RecordedRun, ax: Axes) -> bool:
    """Distance of each link to each line of sight, and of the arm to what is fixed (fig. 10)."""
    every = [
        (values, f"{link}, {camera}" if len(run.cell.config.cameras) > 1 else link)
        for camera, links in run.sight_distances().items()
        for link, values in links.items()
    ]
    every.sort(key=lambda row: float(row[0].min()))
    for i, (values, name) in enumerate(every):
        if i < NAMED_LINKS:
            ax.plot(run.true_time, values, label=name)
        else:
            ax.plot(run.true_time, values, color="0.8", lw=0.8, zorder=0)
    clear = [truth["clearance_m"] for truth in run.truths]
    fixed = all(value is not None for value in clear)
    if fixed:
        ax.plot(run.true_time, clear, "k", label="arm, fixed things")
    between = [t["between_arms_m"] for t in run.truths if t.get("between_arms_m") is not None]
    several = len(between) == len(run.truths)
    if several:
        ax.plot(run.true_time, between, "tab:red", label="arm, arm")
    ax.axhline(0.0, color="0.6", lw=0.8)
    return _named(
        ax,
        "sight line to housing [m]" if every else "distance [m]",
        bool(every) or fixed or several,
    )


def potentials(run: RecordedRun, ax: Axes) -> bool:
    """The potential's parts, each from its least on."""
    felt = [state.get("potential") for state in run.states]
    names = next(([k for k in f if k != "slope"] for f in felt if f is not None), [])
    for name in names:
        values = np.array([np.nan if f is None else f.get(name, np.nan) for f in felt])
        ax.plot(run.time, values - np.nanmin(values), label=name.replace("_", " "))
    return _named(ax, "potential above its least [J]", bool(names))


def slope(run: RecordedRun, ax: Axes) -> bool:
    """Slope of the potential that is left in the self-motions."""
    felt = [state.get("potential") for state in run.states]
    values = np.array([np.nan if f is None else f["slope"] for f in felt])
    drawn = bool((values > 0.0).any())
    if drawn:
        ax.semilogy(run.time, values)
    return _named(ax, "slope |Pτ| [N·m]", drawn, legend=False)


def priority(run: RecordedRun, ax: Axes) -> bool:
    """α, the part of a hand's force that avoiding takes away; and how far each sphere is."""
    values = run.of_states(lambda s: _or_nan(s.get("priority")))
    drawn = bool(np.isfinite(values).any())
    if drawn:
        ax.plot(run.time, values, "k", label="priority α")
        away = [state.get("spheres") or {} for state in run.states]
        for name in sorted({name for spheres in away for name in spheres}):
            distance = [spheres.get(name, np.nan) for spheres in away]
            ax.plot(run.time, distance, lw=0.8, label=f"{name}: distance [m]")
        ax.set_ylim(-0.05, 1.05)
    return _named(ax, "priority of avoiding [1]", drawn)


def rates(run: RecordedRun, ax: Axes) -> bool:
    """Commanded joint rates."""
    values = run.of_states(lambda s: s["dq_command"])
    for i, joint in enumerate(run.joints):
        ax.plot(run.time, values[:, i], label=joint)
    return _named(ax, "joint rates [rad/s]", True)


def self_motion(run: RecordedRun, ax: Axes) -> bool:
    """Joint rates asked of the null space."""
    values = run.of_states(lambda s: np.linalg.norm(s["self_motion"]))
    ax.plot(run.time, values, label="self-motion")
    ax.plot(run.time, run.of_states(lambda s: np.linalg.norm(s["dq_command"])), label="all joints")
    return _named(ax, "size of joint rates [rad/s]", bool(values.any()))


def granted(run: RecordedRun, ax: Axes) -> bool:
    """Share of the asked motion that was granted."""
    ax.plot(run.time, run.of_states(lambda s: s["scale"]))
    ax.set_ylim(-0.05, 1.05)
    return _named(ax, "granted share of the motion", True, legend=False)


def off_path(run: RecordedRun, ax: Axes) -> bool:
    """Displacement of the tool from its path by the virtual link."""
    ways = [state.get("off_path") or (0.0, 0.0, 0.0) for state in run.states]
    values = np.linalg.norm(ways, axis=1)
    ax.plot(run.time, 1e3 * values)
    return _named(ax, "off the path [mm]", bool(values.any()), legend=False)


def tool_path(run: RecordedRun, ax: Axes) -> bool:
    """The tool's true path, from above and from the side."""
    for name, at in run.tool_paths.items():
        whose = f"{name} " if len(run.tool_paths) > 1 else ""
        ax.plot(at[:, 0], at[:, 1], label=f"{whose}from above: y")
        ax.plot(at[:, 0], at[:, 2], label=f"{whose}from the side: z")
        ax.plot(at[0, 0], at[0, 1], "ko", ms=3)
        ax.plot(at[0, 0], at[0, 2], "ko", ms=3)
    ax.set_xlabel("x [m]")
    ax.set_ylabel("tool path [m]")
    ax.legend(fontsize="x-small")
    return True


PANELS: dict[str, Callable[[RecordedRun, Axes], bool]] = {
    "distances": distances,
    "potentials": potentials,
    "slope": slope,
    "priority": priority,
    "rates": rates,
    "self_motion": self_motion,
    "granted": granted,
    "off_path": off_path,
    "tool_path": tool_path,
    "internal_force": internal_force,
}
"""Panels by name; each returns whether there was anything to draw."""


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value


def _named(ax: Axes, what: str, drawn: bool, legend: bool = True) -> bool:
    ax.set_xlabel("time [s]")
    ax.set_ylabel(what)
    ax.margins(x=0.0)
    if drawn and legend:
        ax.legend(fontsize="x-small", ncols=2)
    return drawn
