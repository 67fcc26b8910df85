"""The campaign's table of parts, in the order in which they are run."""

from .asking import ASKING
from .crossings import CROSSINGS
from .crowd_runs import SCENES
from .fuzz.runs import FUZZ
from .hostile_runs import HOSTILE
from .part import Part
from .payloads import PAYLOADS
from .peg_runs import PEG
from .reflection import REFLECTION
from .torques import TORQUES
from .touch import TOUCH
from .wedges import WEDGES
from .wild_runs import WILD

PARTS: dict[str, Part] = {
    "hostile": HOSTILE,
    "peg": PEG,
    "scenes": SCENES,
    "touch": TOUCH,
    "torques": TORQUES,
    "payloads": PAYLOADS,
    "reflection": REFLECTION,
    "wedges": WEDGES,
    "requests": ASKING,
    "fuzz": FUZZ,
    "crossings": CROSSINGS,
    "wild": WILD,
}
