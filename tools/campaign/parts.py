"""The campaign's table of parts, in the order in which they are run."""

from .hostile_runs import HOSTILE
from .part import Part

PARTS: dict[str, Part] = {
    "hostile": HOSTILE,
}
