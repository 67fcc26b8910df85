"""The sources that there are: one row each, by the name of its section in the cell file."""

from types import MappingProxyType
from typing import Any, Final

from .source import Source
from .sources.following import Following
from .sources.force import Force
from .sources.joystick import Joystick
from .sources.position import Position
from .sources.reflex import Reflex
from .sources.spring import Spring
from .sources.vision import Vision

KINDS: Final = MappingProxyType[str, type[Source[Any]]](
    {
        "joystick": Joystick,
        "position": Position,
        "vision": Vision,
        "force": Force,
        "following": Following,
        "spring": Spring,
        "reflex": Reflex,
    }
)
