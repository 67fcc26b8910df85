"""The campaign's table of parts, in the order in which they are run."""

from .arms import ARMS
from .beam import BEAM
from .bridge import BRIDGE
from .contact.peg_runs import PEG
from .contact.reflection import REFLECTION
from .contact.searched import SEARCH
from .contact.touch import TOUCH
from .fuzz.runs import FUZZ
from .hostile.replays import REPLAYS
from .hostile.runs import HOSTILE
from .hostile.wild_runs import WILD
from .kernels.crossings import CROSSINGS
from .kernels.wedges import WEDGES
from .part import Part
from .payloads import PAYLOADS
from .requests import ASKING
from .scenes.runs import SCENES
from .torques import TORQUES
from .tunnels.runs import TUNNEL
from .urdfs.runs import URDF

PARTS: dict[str, Part] = {
    "hostile": HOSTILE,
    "peg": PEG,
    "search": SEARCH,
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
    "arms": ARMS,
    "beam": BEAM,
    "tunnel": TUNNEL,
    "bridge": BRIDGE,
    "replays": REPLAYS,
    "urdf": URDF,
}
