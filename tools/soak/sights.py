"""Cameras without rendering: sightings are computed, and told late, wrong or not at all.

The tag's true pose in the Lens, with noise, at each camera's rate and latency. A tag that is
covered, out of the picture or turned away is not seen. Some sightings come far too late, some leap
to where no tag is, as a misread picture's would.
"""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from ...config.schema.surroundings import CameraSection
from ...protocols.codec import encode
from ...protocols.messages.perception import PoseVector, Sighting
from ...protocols.topics import SIGHTING
from ...server.control.spatial import Pose, rotation_exp
from ..simulation.judges.view import ViewJudge
from ..simulation.simulation import Simulation

NOISE = (5e-4, 3e-3)
"""Standard deviation of a seen pose [m], [rad]."""
LATE, LATE_S = 0.05, 0.6
"""Part of the sightings that come late [1], by at most this [s]."""
LEAPING, LEAP = 0.03, 0.2
"""Part of the sightings that leap [1], by at most this along each axis [m]."""
FACING = 0.3
"""A tag is seen up to where its face is this much turned to the Lens: the cosine [1]."""


@dataclass
class _Eye:
    camera: CameraSection
    due_s: float = 0.0
    underway: deque[tuple[float, bytes]] = field(default_factory=deque)
    """Arrival of each sighting [s], and its bytes."""


class ComputedSights:
    """All cameras of a simulated cell; equal seeds see equally."""

    def __init__(self, simulation: Simulation, seed: int) -> None:
        cell = simulation.cell
        rig = cell.config.rig
        self._simulation = simulation
        self._judge = ViewJudge(cell)
        self._names = {t.tag: t.name for t in (rig.tags if rig is not None else ())}
        self._eyes = [_Eye(camera) for camera in cell.config.cameras]
        self._draw = np.random.default_rng([seed, *b"sights"])

    def run(self, now_s: float, tick: int) -> None:
        """Hand over what has arrived by `now_s`, and look at what is exposed at SYNC `tick`."""
        for eye in self._eyes:
            while eye.underway and eye.underway[0][0] <= now_s + 1e-9:
                self._simulation.link.put(SIGHTING, eye.underway.popleft()[1])
            if now_s < eye.due_s - 1e-9:
                continue
            eye.due_s = now_s + 1.0 / eye.camera.rate_hz
            late_s = self._draw.uniform(0.0, LATE_S) if self._draw.random() < LATE else 0.0
            arrives_s = now_s + eye.camera.latency_s + late_s
            eye.underway.append((arrives_s, encode(self._look(eye.camera, tick))))

    def close(self) -> None:
        """Nothing was opened."""

    def _look(self, camera: CameraSection, tick: int) -> Sighting:
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
        return Sighting(camera=camera.name, tick=tick, poses=(pose,), errors_px=(0.3,), quality=0.9)


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
