"""All checks of a cell, in the order in which they are told."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final

from ...config.load import Cell
from .arms import arms
from .bus_load import bus_load
from .drives import drives
from .enabling import enabling
from .findings import Finding
from .holding import holding
from .loops.following import following
from .loops.joint_tasks import joint_tasks
from .loops.reflection import reflection
from .loops.stability import stability
from .loops.torque import torque
from .model.postures import postures
from .model.starting import starting
from .network import network
from .rover.own_rays import own_rays
from .rover.sight import sight
from .rover.sweep import sweep
from .rover.wheels import wheels
from .sensors import sensors
from .timing import sampling, timing
from .tunnel import tunnel

Check = Callable[[Cell], Iterator[Finding]]

OF_THE_CELL: Final[tuple[Check, ...]] = (
    timing,
    network,
    bus_load,
    arms,
    joint_tasks,
    starting,
)

OF_AN_ARM: Final[tuple[Check, ...]] = (
    sampling,
    drives,
    enabling,
    stability,
    reflection,
    postures,
    tunnel,
    wheels,
    sweep,
    sight,
    own_rays,
    holding,
    torque,
    following,
    sensors,
)


def judge(cell: Cell) -> list[Finding]:
    """Return what every check found about a cell, and about each of its arms by its name."""
    found = [finding for check in OF_THE_CELL for finding in check(cell)]
    for part in cell.parts:
        of_arm = [finding for check in OF_AN_ARM for finding in check(part)]
        found += [replace(finding, check=f"{part.prefix}{finding.check}") for finding in of_arm]
    return found
