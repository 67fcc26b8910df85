"""One trial of force reflection over an emulated network, judged by the truth of both sides.

What the wall feels is the rig's contact force along its normal, what the hand feels the simulated
device's own: the trial asks neither the daemon nor what protects the handle.
"""

from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from telerobot.config.load import Cell, altered
from telerobot.protocols import topics as t
from telerobot.server.control.spatial import Array
from telerobot.server.reflection import pose_stiffness
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.simulation import Simulation

Mode = Literal["rate", "pose"]

SCRIPTS: dict[Mode, str] = {"rate": "reflect_rate", "pose": "reflect_pose"}

TOUCH_N = 0.1
"""Contact is more than this [N]."""
RIPPLE_MAX, MEAN_MAX, PEAK_MAX_N, RELEASE_MAX_S = 0.15, 0.05, 24.0, 2.5
"""Promises: ripple and error of the mean [1], peak for a contact of 10 N, time to no force."""
LEAST_ENERGY_J = -0.05
"""Promise: what the network may have given out at most, at both ports together [J]."""
SETTLED_S, WINDOW_S = 6.0, 1.0
"""A contact has settled after this long, judged over the second before [s]."""


@dataclass(frozen=True)
class ReflectionTrial:
    """Result of one trial."""

    mode: Mode
    rtt_s: float
    protected: bool
    stiffness: float
    """Reflected in pose mode, at most [N/m]."""
    ripple: float
    """Greatest less least contact force within a second, by its mean [1]."""
    mean_error: float
    """Rate mode: mean force against K_HC u / K_F, as a part of that [1]."""
    peak_n: float
    release_s: float
    """From when the hand begins to let off until the wall feels nothing [s]."""
    least_energy_j: float
    """Pose mode: least energy held by the network, the hand's work less that of the tool [J]."""
    drift_m: float
    """Pose mode: how far the tool ends from where the master has led it [m]."""
    failure: str = ""
    """Reason why there is nothing to judge."""

    @property
    def faults(self) -> tuple[str, ...]:
        """Promises that it breaks, each with its number."""
        if self.failure:
            return (self.failure,)
        broken = [f"ripple {self.ripple:.0%}"] if not self.ripple < RIPPLE_MAX else []
        if self.mode == "pose":
            if not self.least_energy_j >= LEAST_ENERGY_J:
                broken.append(f"energy {self.least_energy_j:.3f} J")
            return tuple(broken)
        if not abs(self.mean_error) < MEAN_MAX:
            broken.append(f"mean off by {self.mean_error:.0%}")
        if not self.peak_n < PEAK_MAX_N:
            broken.append(f"peak {self.peak_n:.1f} N")
        if not self.release_s < RELEASE_MAX_S:
            broken.append(f"release after {self.release_s:.1f} s")
        return tuple(broken)

    def figures(self) -> dict[str, object]:
        """Return everything as plain values, for JSON."""
        return asdict(self) | {"faults": self.faults}


@dataclass(frozen=True)
class _Log:
    """A trial tick by tick, from when its script began."""

    t: Array
    force: Array
    """True contact force (k, 3), World [N]."""
    tool: Array
    """True place of the MRF (k, 3), World [m]."""
    handle: Array
    """True place of the handle (k, 3) [m]."""
    work: Array
    """Work of the hand so far (k,) [J]."""


def trial(
    cell: Cell,
    mode: Mode,
    rtt_s: float,
    protected: bool = True,
    stiffness: float | None = None,
    seed: int = 1,
) -> ReflectionTrial:
    """Play the shipped script of a mode at a round trip, 20 % jitter and 5 % loss; judge it."""
    config = cell.config.reflection
    if config is None:
        raise ValueError(f"{cell.path}: the cell has no [reflection]")
    if stiffness is not None:
        cell = altered(cell, {"reflection.stiffness": stiffness})
    script = _script(SCRIPTS[mode], rtt_s, protected, seed)
    simulation, log = _played(cell, script)
    failure = simulation.player.failure or "; ".join(simulation.player.refused)
    force = log.force @ _into_wall(cell)
    touched = np.flatnonzero(force > TOUCH_N)
    if not failure and not len(touched):
        failure = "the wall was not touched"
    if failure:
        nan = float("nan")
        return ReflectionTrial(
            mode, rtt_s, protected, config.stiffness, nan, nan, nan, nan, nan, nan, failure
        )
    settled_s = log.t[touched[0]] + SETTLED_S
    window = (log.t > settled_s - WINDOW_S) & (log.t <= settled_s)
    mean = float(force[window].mean())
    ripple = float(np.ptp(force[window])) / max(mean, 1e-9)
    u = log.handle[window, 0].mean() * config.handle.speed / config.handle.travel
    expected = cell.config.sources.joystick.gain[0] * u / min(cell.config.sources.force.gain[:3])
    lets_off_s = max(step.at_s for step in script.steps if step.device is not None)
    return ReflectionTrial(
        mode,
        rtt_s,
        protected,
        config.stiffness,
        ripple,
        mean / expected - 1.0 if mode == "rate" else 0.0,
        float(force.max()),
        float(log.t[touched[-1]] - lets_off_s),
        _least_energy(cell, script, log) if mode == "pose" else 0.0,
        _drift(script, log) if mode == "pose" else 0.0,
    )


def _into_wall(cell: Cell) -> Array:
    """Return the direction (3,) that a force pushes the wall in, World."""
    wall = None if cell.config.rig is None else cell.config.rig.wall
    if wall is None:
        raise ValueError(f"{cell.path}: rig.wall: missing: there is nothing to push")
    normal = np.array(wall.normal)
    return np.asarray(-normal / np.sqrt(normal @ normal))


def _script(name: str, rtt_s: float, protected: bool, seed: int) -> Script:
    script = load_script(name)
    told: dict[str, Any] = {"rtt_s": rtt_s, "seed": seed}
    network = script.network.model_copy(update=told)
    steps = script.step
    if not protected:
        off = Script.model_validate(
            {
                "duration_s": 1.0,
                "step": [{"at_s": 0.0, "operator/reflection": {"protected": False}}],
            }
        )
        steps = (*off.step, *steps)
    return script.model_copy(update={"network": network, "step": steps})


def _played(cell: Cell, script: Script) -> tuple[Simulation, _Log]:
    simulation = Simulation(cell, script)
    rows: list[tuple[float, list[float], list[float], list[float], float]] = []

    def look(running: Simulation) -> None:
        truth, clients = running.truths[-1], running.player.operators.handles.values()
        for client in clients:
            device = client.device
            rows.append(
                (
                    running.clock.time_s - running.player.start_s,
                    list(truth.contact_force),
                    list(truth.pose_mrf[:3]),
                    device.p.tolist(),
                    device.work,
                )
            )

    simulation.on_tick = look
    simulation.run()
    columns = zip(*rows, strict=True) if rows else ([], [], [], [], [])
    t, force, tool, handle, work = (np.array(column, dtype=float) for column in columns)
    return simulation, _Log(t, force.reshape(-1, 3), tool.reshape(-1, 3), handle, work)


def _least_energy(cell: Cell, script: Script, log: _Log) -> float:
    """Return the least of what the hand has put in less what the tool has got out [J]."""
    scale = _scale(script)
    sources, config = cell.config.sources, cell.config.reflection
    sensor = cell.config.mechanism.force_torque
    if config is None or sensor is None:
        raise ValueError(f"{cell.path}: the cell reflects no forces")
    full = pose_stiffness(
        np.array(config.gain),
        scale,
        np.array(sources.force.gain),
        np.array(sources.position.gain),
        sensor.stiffest_environment,
    )
    share = max(config.gain[:3]) * min(1.0, config.stiffness / full) / scale
    moved = np.diff(log.tool, axis=0, prepend=log.tool[:1])
    at_tool = np.cumsum((log.force * moved).sum(axis=1))
    return float((log.work - share * at_tool).min())


def _drift(script: Script, log: _Log) -> float:
    led = _scale(script) * (log.handle[-1] - log.handle[0])
    away = log.tool[-1] - log.tool[0] - led
    return float(np.sqrt(away @ away))


def _scale(script: Script) -> float:
    told = [fields for step in script.steps if (fields := step.says(t.CLUTCH)) is not None]
    return next((fields["translation"] for fields in told if "translation" in fields), 1.0)
