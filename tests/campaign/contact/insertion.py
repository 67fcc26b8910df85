"""One insertion of a peg into a misplaced hole, judged by the physics.

The verdict knows true poses and true contact forces only. Depth is that of the middle of the peg's
end below the mouth, along the hole's own axis, as long as it is within the hole. Force is looked at
in every physics step, as its mean over a millisecond, twice: the net force, which the arm pushes
the block with, and the sum of magnitudes over the solids of peg and block that touch, in which
opposite walls do not cancel. A tilted peg touches both sides of its hole; what turns it upright is
a couple of two such forces, many times the net one where they are near each other. So the sum has a
bound of its own: 72 to 119 N in all directions, with net forces of 16 to 29 N. A millisecond is a
quarter of the contacts' own time constant: below that a force is the solver's, which goes on and
off from step to step where a peg sticks and slips (137, 10, 126 N), and the more the shorter they
are. As a mean, direction 23 has 117, 119, 112 and 111 N at the cell's physics step, a half, a
quarter and an eighth of it.

Directions 0 to 11 are those of the offset, every 30 degrees from the hole's x axis, with the hole
leaning to the left of its offset; in 12 to 23 it leans back against it.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from laboratory.oracle.poses import rotation
from telerobot.config.load import Cell, ConfigError, altered, load_cell
from telerobot.config.schema.section import PoseSection
from telerobot.tools.scripts.script import load_script
from telerobot.tools.simulation.judges import peg_depths
from telerobot.tools.simulation.simulation import Simulation

CELL = "pa10_peg"
SCRIPTS = {False: "peg_insert", True: "peg_insert_stiff"}
"""By whether force control is off."""
OFFSET, TILT = 0.003, math.radians(2.0)
"""Offset and tilt of the hole [m], [rad]."""
AZIMUTHS = 12
"""Directions of the offset, evenly around the hole's axis [1]."""
LEANS = (0.5 * math.pi, math.pi)
"""From the direction of the offset to the one that the hole leans to [rad]."""
DIRECTIONS = AZIMUTHS * len(LEANS)
DEEP, WITHIN_S, GENTLE, SQUEEZED = 0.030, 20.0, 35.0, 130.0
"""An insertion succeeds when it is this deep [m] within this time [s], below this net force and
this sum of magnitudes [N]."""
BLOW_S = 1e-3
"""Forces are means over so long [s]: what no physics step changes."""
ROUGH = 100.0
"""Without force control, this net force is exceeded where the peg goes in at all [N]."""


class Attempt(NamedTuple):
    """One attempt's conditions."""

    direction: int
    """0 to `DIRECTIONS` - 1."""
    stiff: bool
    """Force control is off."""
    part: int = 1
    """Divides the cell's physics step [1]."""


@dataclass(frozen=True)
class PegInsertion:
    """Result of one attempt; all plain values."""

    direction: int
    stiff: bool
    part: int
    depth_m: float
    deep_s: float
    """Time at which it was `DEEP`, since the arm was enabled; inf for never [s]."""
    net_n: float
    """Greatest net force over a millisecond [N]."""
    peak_n: float
    """Greatest sum of magnitudes over a millisecond [N]."""
    limit_violations: int
    end: str
    """Cause of an early end, or empty."""

    @property
    def name(self) -> str:
        """Direction, control and step."""
        return f"peg {self.direction} {'stiff' if self.stiff else 'force'} step 1/{self.part}"

    @property
    def inserted(self) -> bool:
        """True when the peg is in, in time and gently."""
        return not self.against

    @property
    def against(self) -> str:
        """What speaks against a gentle insertion, or empty."""
        if self.end:
            return f"ended early: {self.end}"
        if not self.deep_s < WITHIN_S:
            return "not inserted"
        if not self.net_n < GENTLE:
            return f"pushed beyond {GENTLE:g} N net"
        return "" if self.peak_n < SQUEEZED else f"squeezed beyond {SQUEEZED:g} N in all"

    @property
    def rough(self) -> bool:
        """True when the peg is not in, or was forced in."""
        return self.net_n > ROUGH or math.isinf(self.deep_s) or bool(self.end)

    @property
    def words(self) -> str:
        """Depth, time and peaks."""
        when = "   -  " if math.isinf(self.deep_s) else f"{self.deep_s:4.1f} s"
        return f"{1e3 * self.depth_m:4.1f} mm {when} {self.net_n:3.0f} N net, {self.peak_n:5.0f} N"

    @property
    def reasons(self) -> list[str]:
        """Broken promises; of a stiff attempt, that it was gentle."""
        found = [f"{self.limit_violations} limit violations"] if self.limit_violations else []
        if self.stiff and not self.rough:
            found.append(f"went in gently without force control: {self.words}")
        if not self.stiff and self.against:
            found.append(f"{self.against}: {self.words}")
        return found


def misplaced(direction: int) -> PoseSection:
    """Return where the hole really is, measured from where it is meant to be."""
    around = 2.0 * math.pi * (direction % AZIMUTHS) / AZIMUTHS
    leaning = around + LEANS[direction // AZIMUTHS]
    # A lean towards an azimuth is a turn about the horizontal axis a quarter turn ahead of it.
    R = rotation(TILT * np.array([-math.sin(leaning), math.cos(leaning), 0.0]))
    pitch = math.atan2(-R[2, 0], math.hypot(R[0, 0], R[1, 0]))
    rpy = (math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0]))
    return PoseSection(xyz=(OFFSET * math.cos(around), OFFSET * math.sin(around), 0.0), rpy=rpy)


def cell_of(what: Attempt) -> Cell:
    """Return the cell of an attempt. Raises `ConfigError` if there is none."""
    cell = load_cell(CELL)
    rig = cell.config.rig
    if rig is None or not rig.holes:
        raise ConfigError(f"{cell.path}: rig.holes: missing: there is nothing to insert into")
    hole = rig.holes[0].model_copy(update={"misplaced": misplaced(what.direction)})
    step_s = rig.physics_step_s / what.part
    rig = rig.model_copy(update={"holes": (hole,), "physics_step_s": step_s})
    return altered(cell, {"rig": rig})


class _DepthWatch:
    """Looks at the physics in every step."""

    def __init__(self, simulation: Simulation) -> None:
        self.net = self.peak = 0.0
        steps = max(1, round(BLOW_S / simulation.rig.dt))
        self._newest = deque([np.zeros(2)] * steps, steps)
        self.depth = -math.inf
        self.deep_s = math.inf
        simulation.on_physics = self._on_physics
        simulation.on_tick = self._on_tick

    def _on_physics(self, simulation: Simulation) -> None:
        contacts = simulation.rig.world.contacts
        self._newest.append(np.array([np.linalg.norm(contacts.force(0)), contacts.total(0)]))
        net, total = np.mean(self._newest, axis=0).tolist()
        self.net, self.peak = max(self.net, net), max(self.peak, total)

    def _on_tick(self, simulation: Simulation) -> None:
        self.depth = peg_depths(simulation.cell, simulation.truths[-1])[0]
        if self.depth >= DEEP and math.isinf(self.deep_s):
            self.deep_s = simulation.clock.time_s - simulation.player.start_s


def attempt(what: Attempt) -> PegInsertion:
    """Try it in virtual time; a fault ends it."""
    cell = cell_of(what)
    simulation = Simulation(cell, load_script(SCRIPTS[what.stiff]))
    watch = _DepthWatch(simulation)
    result = simulation.run()
    errors = [e.detail for e in simulation.events if e.severity == "error"]
    end = str(result.summary["failure"] or "; ".join(errors[:1]))
    return PegInsertion(
        direction=what.direction,
        stiff=what.stiff,
        part=what.part,
        depth_m=watch.depth,
        deep_s=watch.deep_s,
        net_n=watch.net,
        peak_n=watch.peak,
        limit_violations=len(simulation.observer.violations),
        end=end,
    )
