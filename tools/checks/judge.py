"""All checks of a cell, in the order in which they are told."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final

from ...config.load import Cell
from .cell import arms, bus_load, network, sampling, sensors, timing
from .drives import carried, contact, drives, enabling, following, holding, torque
from .findings import Finding
from .loops import joint_tasks, reflection, stability
from .model import postures, starting, tunnel
from .rover import own_rays, sight, sweep, wheels

Check = Callable[[Cell], Iterator[Finding]]

OF_THE_CELL: Final[tuple[Check, ...]] = (
    timing,
    network,
    bus_load,
    arms,
    joint_tasks,
    starting,
    carried,
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
    contact,
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
