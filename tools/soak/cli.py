"""`telerobot soak`: hostile operators against one's own cell."""

import argparse
import math
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from pydantic import TypeAdapter

from ...config.errors import ConfigError
from ...config.load import load_cell
from ...config.schema.surroundings import CameraSection
from ...drivers.rig.cameras import SimulatedCameras
from ...protocols.messages.perception import PoseVector, Sighting
from ...protocols.messages.telemetry import Event
from ...server.control.spatial import Pose, rotation_exp
from ...server.perception.cameras import board_of
from ...server.perception.filters import pictured
from ..host import jobs
from ..simulation.judges import ViewJudge
from ..simulation.simulation import Simulation
from .segments import script

# --- Cameras without rendering: sightings are computed, and told late, wrong or not at all --------
#
# The tag's true pose in the Lens, with noise, at each camera's rate and latency. A tag that is
# covered, out of the picture or turned away is not seen. Some sightings come far too late, some
# leap to where no tag is, as a misread picture's would.
NOISE = (5e-4, 3e-3)  # standard deviation of a seen pose [m], [rad]
LATE, LATE_S = 0.05, 0.6  # part of the sightings that come late [1], by at most this [s]
LEAPING, LEAP = 0.03, 0.2
"""Part of the sightings that leap [1], by at most this along each axis [m]."""
FACING = 0.3  # a tag is seen up to where its face is this much turned to the Lens: the cosine [1]


class ComputedSights(SimulatedCameras):
    """All cameras of a simulated cell; equal seeds see equally."""

    def __init__(self, simulation: Simulation, seed: int) -> None:
        cell = simulation.cell
        super().__init__(cell.config.cameras, simulation.link.put)
        rig = cell.config.rig
        self._simulation = simulation
        self._judge = ViewJudge(cell)
        self._names = {t.tag: t.name for t in (rig.tags if rig is not None else ())}
        self._draw = np.random.default_rng([seed, *b"sights"])

    def _look(self, camera: CameraSection, tick: int) -> tuple[Sighting, float]:
        late_s = self._draw.uniform(0.0, LATE_S) if self._draw.random() < LATE else 0.0
        return self._seen(camera, tick), late_s

    def _seen(self, camera: CameraSection, tick: int) -> Sighting:
        truths = self._simulation.truths
        seen = self._judge.view(truths[-1], camera.name) if truths else None
        if (
            seen is None
            or self._names[camera.tag] in truths[-1].covered
            or not _shown(camera, seen)
        ):
            return Sighting(camera=camera.name, tick=tick)
        metres, radians = NOISE
        p = seen.p + self._draw.normal(0.0, metres, 3)
        if self._draw.random() < LEAPING:
            p = p + self._draw.uniform(-LEAP, LEAP, 3)
        R = rotation_exp(self._draw.normal(0.0, radians, 3)) @ seen.R
        pose: PoseVector = Pose(R, p).to_xyz_rpy()
        corners = board_of(camera)[camera.tag] @ R.T + p
        near = bool((np.abs(corners[:, :2]) < 10.0 * corners[:, 2:]).all())  # no lens sees wider
        return Sighting(
            camera=camera.name,
            tick=tick,
            poses=(pose,),
            errors_px=(0.3,),
            seen=((camera.tag, tuple(pictured(corners).ravel().tolist())),) if near else (),
            quality=0.9,
        )


def _shown(camera: CameraSection, seen: Pose) -> bool:
    """Return whether a tag's middle is in the picture, and its face turned to the Lens."""
    x, y, z = seen.p.tolist()
    if z <= 0.0:
        return False
    column, row = (
        c + f * w / z for c, f, w in zip(camera.centre, camera.focal, (x, y), strict=True)
    )
    inside = 0.0 <= column < camera.size[0] and 0.0 <= row < camera.size[1]
    facing = -float(seen.R[:, 2] @ seen.p) / math.sqrt(float(seen.p @ seen.p))
    return inside and facing > FACING


# --- What arms run into, step by step of the physics, and which faults that explains --------------
#
# A joint that meets something nobody told of, faster than the leash can stop it, falls behind
# its command: in a cell without `[touch]` a quick stop by the table of stops. Where contact is
# felt, the arm stops and gives way instead. Any other cause of a fault, and any fault that no touch
# goes before, has another reason, whatever was touched earlier in the run.
FELT_N: Final = 5.0  # contact force from which a touch can hold a joint up [N]
SINCE_S: Final = 0.5  # a fault so long after a touch is explained by it [s]
EXCUSED: Final = ("following_error",)
"""Causes of faults that a touch explains where no contact is felt: command and joint come apart."""


class Touches:
    """Watches a simulation that is yet to run; takes its `on_physics`."""

    def __init__(self, simulation: Simulation) -> None:
        self.most_n = 0.0  # greatest force on what stands around, or between parts of arms [N]
        self._simulation = simulation
        self._blind = not all(part.config.touch for part in simulation.cell.parts)
        self._times: list[float] = []
        simulation.on_physics = self._look

    @property
    def felt(self) -> bool:
        """True once a touch could hold a joint up."""
        return bool(self._times)

    def explain(self, event: Event) -> bool:
        """Return whether an event is a fault that a touch just before it explains.

        None is in a cell whose arms all feel contact (`[touch]`).
        """
        if event.name != "fault" or event.values.get("cause") not in EXCUSED or not self._blind:
            return False
        return any(0.0 <= event.time_s - at_s <= SINCE_S for at_s in self._times)

    def unexplained(self, *, excused: bool = True) -> list[str]:
        """Return the errors of the run so far that no touch explains, a line each.

        All errors where nobody is `excused`: of a run in which nothing is to be run into.
        """
        return [
            f"{event.name} at {event.time_s:.2f} s: {event.detail}"
            for event in self._simulation.events
            if event.severity == "error" and not (excused and self.explain(event))
        ]

    def _look(self, simulation: Simulation) -> None:
        force = simulation.rig.world.contacts.greatest()
        self.most_n = max(self.most_n, force)
        now_s = simulation.clock.time_s
        if force > FELT_N and (not self._times or now_s > self._times[-1]):
            self._times.append(now_s)


# --- `telerobot soak CELL`: hostile operators against a cell, in virtual time, from seeds ---------
#
# They hold every lever at once, ask for what cannot be, change gains and frames while the arm
# moves, fall silent and come back, and sensors fail beside them. No bound may be broken on the
# bus, and no fault may come but by what the arm ran into, and only in a cell without `[touch]`.
# The cell is taken as its file says it is.
@dataclass(frozen=True)
class Soaked:
    """The run of one seed; plain values."""

    seed: int
    ticks: int
    reasons: list[str]  # broken promises
    most_n: float  # greatest force on what stands around, or between parts of the arm [N]
    command_hash: str


_ROWS = TypeAdapter(Soaked)


def run(args: argparse.Namespace) -> int:
    """Play every seed; return 0 if all promises were kept, 130 if interrupted."""
    cell = load_cell(args.cell)
    if len(cell.parts) > 1:
        raise ConfigError(f"{cell.path}: mechanisms: {len(cell.parts)} tables: soak leads one arm")
    finished = jobs.run_all(
        partial(soaked, str(args.cell)),
        args.seeds,
        jobs.place_of(args),
        "soak",
        lambda run: f"seed {run.seed}: {'; '.join(run.reasons) or 'well'}"[:200],
        lambda _, run: _ROWS.dump_python(run),
        lambda _, kept: _ROWS.validate_python(kept),
        lambda seed: f"{args.cell}, {seed}",
    )
    failed = [run for run in finished.results if run.reasons]
    hit = sum(run.most_n > 0.0 for run in finished.results)
    print(
        f"{len(finished.results)} runs, {sum(run.ticks for run in finished.results)} ticks, "
        f"{hit} ran into something: {len(failed)} broke a promise"
    )
    for run in failed:
        print(f"telerobot soak {args.cell} --seeds {run.seed}  # {run.reasons[0]}")
    if finished.interrupted:
        return 130
    return 1 if failed else 0


def soaked(name: str, seed: int) -> Soaked:
    """Play the hostile operators of a seed against a cell. Raises `ConfigError`."""
    cell = load_cell(name)
    simulation = Simulation(cell, script(cell, seed), cameras=lambda s: ComputedSights(s, seed))
    touches = Touches(simulation)
    summary = simulation.run().summary
    reasons = touches.unexplained()
    if summary["failure"] is not None:
        reasons.append(f"not played: {summary['failure']}")
    reasons += [
        f"{v.joint} {v.kind} {v.value:.6g} over {v.bound:.6g} at {v.time_s:.3f} s"
        for v in simulation.observer.violations[:5]
    ]
    return Soaked(
        seed, len(simulation.states), reasons, touches.most_n, str(summary["command_hash"])
    )
