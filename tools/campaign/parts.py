"""The campaign's table of parts, in the order in which they are run."""

from .hostile_runs import HOSTILE
from .part import Part
from .peg_runs import PEG

PARTS: dict[str, Part] = {
    "hostile": HOSTILE,
    "peg": PEG,
}
