"""A tool that slides along the wall or the table of the cell `pa10`, there and back."""

import math
from itertools import product
from typing import Any, NamedTuple

from telerobot.config.load import Cell, altered
from telerobot.tools.scripts.script import Script

DOWN = (0.0, 0.3, 0.0, 1.9, 0.0, math.pi - 2.2, 0.0)
"""A posture with the tool above the table, pointing down [rad]."""
APPROACH = 0.05
"""Speed at which contact is made [m/s]."""
DIRECTIONS = 8
REACH = 0.1
"""Greatest length [m] and time [s] of a slide, one way."""
AT_MOST_S = 2.0
MADE_S, SLIDES_S, AFTER_S = 5.0, 6.0, 0.6
"""Contact has been made by then, and sliding begins; so long it goes on being watched [s]."""


class Slide(NamedTuple):
    """One slide: surface, force, speed, direction."""

    surface: str
    force: float
    """Pressed with [N]."""
    speed: float
    """Asked of the stick along the surface [m/s]."""
    direction: int
    """Of `DIRECTIONS`, counted from y on the wall, from x on the table."""

    def __str__(self) -> str:
        turn = 360 * self.direction // DIRECTIONS
        return f"{self.surface} {self.force:g} N {self.speed:g} m/s {turn} deg"


SLIDES = tuple(
    Slide(*each)
    for each in product(("wall", "table"), (10.0, 60.0), (0.02, 0.05, 0.1), range(DIRECTIONS))
)


def as_declared(cell: Cell) -> Cell:
    """Return the cell with a table as soft as the wall that it declares: its own is rigid.

    On a rigid one its force control rings at the first touch, and is slowed down to a hundredth.
    """
    rig = cell.config.rig
    if rig is None or rig.wall is None:
        raise ValueError(f"cell {cell.config.name}: needs a wall")
    (table,) = (box for box in rig.boxes if box.name == "table")
    x, y, z = table.xyz
    told = {"xyz": (x, y, z + table.half_size[2]), "normal": (0.0, 0.0, 1.0)}
    return altered(cell, {"wall": rig.wall.model_copy(update=told), "boxes": ()}, "rig")


def sliding(cell: Cell, slide: Slide) -> Script:
    """Return the script: to the surface, pressing by stick and force control, along and back."""
    wall, angle = slide.surface == "wall", 2.0 * math.pi * slide.direction / DIRECTIONS
    c, s = math.cos(angle), math.sin(angle)
    into, along = ((1.0, 0.0, 0.0), (0.0, c, s)) if wall else ((0.0, 0.0, -1.0), (c, s, 0.0))
    pressing = slide.force * cell.config.sources.force.gain[0]
    one_way_s = min(AT_MOST_S, REACH / slide.speed)

    def stick(at_s: float, press: float, speed: float) -> dict[str, Any]:
        linear = [press * i + speed * a for i, a in zip(into, along, strict=True)]
        twist = {"twist": [*linear, 0.0, 0.0, 0.0], "expressed_in": "base"}
        return {"at_s": at_s, "cmd/joystick": twist}

    back_s = SLIDES_S + one_way_s
    end_s = back_s + one_way_s
    return Script.model_validate(
        {
            "duration_s": end_s + AFTER_S,
            "step": [
                {"at_s": 0.1, "cmd/posture": {"posture": "ready"} if wall else {"q": DOWN}},
                stick(3.2, APPROACH, 0.0),
                stick(MADE_S, pressing, 0.0),
                stick(SLIDES_S, pressing, slide.speed),
                stick(back_s, pressing, -slide.speed),
                stick(end_s, pressing, 0.0),
            ],
        }
    )
