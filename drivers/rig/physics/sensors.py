"""What the rig's sensors see: the rays of a laser scanner, and where planar tags are."""

import math
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....config.load import Cell
from ....config.schema.rig import RigScannerSection
from ....config.schema.surroundings import RigTagSection, ScannerSection
from ....protocols.messages.messages import Vector6
from ....protocols.messages.rig import FARTHEST, RigFault, vector_of
from ....protocols.sick import Scan
from .geoms import quaternion

# --- The rays of a laser scanner, each cast when its turn comes, in physics time ------------------

Vector = NDArray[np.float64]


class Rangefinder:
    """Turns its mirror as physics time passes; noise is the same in equal runs."""

    def __init__(self, cell: Cell, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Mount it where the cell says. Raises `ValueError` for a link that there is not."""
        scanner, rig = cell.config.scanner, cell.config.rig
        if scanner is None or rig is None:
            raise ValueError(f"cell {cell.config.name} has no scanner to simulate")
        self._model, self._data = model, data
        self.scanner: ScannerSection = scanner
        self._rig: RigScannerSection = rig.scanner
        link = cell.prefix + scanner.link
        self._body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, link)
        if self._body < 0:
            raise ValueError(f"scanner.link: value '{scanner.link}': no such body")
        self._p = np.array(scanner.T_link_scanner.xyz)
        R = np.zeros(9)
        mujoco.mju_quat2Mat(R, np.array(quaternion(scanner.T_link_scanner)))
        self._R = R.reshape(3, 3)
        self._rng = np.random.default_rng([rig.seed, 2])
        angle = scanner.first + scanner.step * np.arange(scanner.rays)
        self._along = np.stack([np.sin(angle), -np.cos(angle), np.zeros(len(angle))], axis=1)
        self._ray_s = scanner.step / (2.0 * math.pi * scanner.rate_hz)
        """From ray to ray [s]."""
        self._start_s, self._next = 0.0, 0
        self._scans = 0
        self._distance = np.full(scanner.rays, np.nan)

    def step(self, time_s: float) -> Scan | None:
        """Cast the rays that are due by a time [s]; return the scan when its last one was."""
        scanner = self.scanner
        due = min(scanner.rays, math.floor((time_s - self._start_s) / self._ray_s + 1e-6) + 1)
        if due > self._next:
            self._distance[self._next : due] = self._cast(self._along[self._next : due])
            self._next = due
        if self._next < scanner.rays:
            return None
        scan = Scan(
            count=self._scans % (1 << 16),
            start_us=round(self._start_s * 1e6) % (1 << 32),
            sent_us=round(time_s * 1e6) % (1 << 32),
            frequency_hz=scanner.rate_hz,
            first_rad=scanner.first,
            step_rad=scanner.step,
            distances=self._distance.copy(),
        )
        self._scans += 1
        self._start_s, self._next = self._scans / scanner.rate_hz, 0
        return scan

    def _cast(self, along: Vector) -> Vector:
        """Return the distances of rays (n,) [m]; NaN without an echo."""
        data, n = self._data, len(along)
        R = data.xmat[self._body].reshape(3, 3)
        origin = data.xpos[self._body] + R @ self._p
        toward = along @ (R @ self._R).T
        found, geom = np.empty(n), np.empty(n, dtype=np.int32)
        mujoco.mj_multiRay(
            self._model, data, origin, toward.reshape(-1), None, True, self._body, geom, found,
            None, n, self._rig.range,
        )  # fmt: skip
        noisy = found + self._rng.normal(0.0, 1.0, n) * self._rig.noise
        noisy[(found < self._rig.least) | (found > self._rig.range)] = np.nan
        return noisy


# --- The planar tags of the virtual world: where they are, and which are covered ------------------

KINDS = ("cover", "move")
"""Kinds of faults whose target is a tag."""


class Tags:
    """Effects of faults on a rig's tags."""

    def __init__(self, tags: Sequence[RigTagSection]) -> None:
        self._home: dict[str, Vector6 | None] = {}
        for tag in tags:
            place = tag.T_world_tag
            self._home[tag.name] = None if place is None else (*place.xyz, *place.rpy)
        self._moved: dict[str, Vector6] = {}
        self._covered: set[str] = set()

    @property
    def covered(self) -> tuple[str, ...]:
        """Names of the tags that nobody can see now."""
        return tuple(sorted(self._covered))

    @property
    def poses(self) -> dict[str, Vector6]:
        """Where each tag that stands in World is now: x, y, z [m], roll, pitch, yaw [rad]."""
        standing = {name: pose for name, pose in self._home.items() if pose is not None}
        return standing | self._moved

    def inject(self, fault: RigFault) -> None:
        """Cover or move a tag, or take that back. Raises `ValueError`, in one line."""
        name = fault.target
        if name not in self._home:
            known = ", ".join(self._home) or "none"
            raise ValueError(f"fault {fault.kind}: no tag {name!r}; there are {known}")
        if fault.kind == "cover":
            (self._covered.add if fault.on else self._covered.discard)(name)
            return
        home = self._home[name]
        if home is None:
            raise ValueError(f"fault move: the arm carries tag {name}")
        if not fault.on:
            self._moved.pop(name, None)
        else:
            x, y, z = vector_of(fault, FARTHEST, "m").tolist()
            self._moved[name] = (x, y, z, *home[3:])
