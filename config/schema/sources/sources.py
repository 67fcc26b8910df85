"""The sources that there are: one field each."""

from typing import Annotated

from pydantic import AfterValidator, Field

from ..section import Section
from .following import Following
from .force import Force
from .joystick import Joystick
from .position import Position
from .reflex import Reflex
from .source import Source
from .spring import Spring
from .vision import Vision


class Sources(Section):
    """Sources, which ask the tool for rates. All on at once; the rates add."""

    joystick: Joystick = Field(default_factory=Joystick, description="the operator's stick")
    position: Position = Field(default_factory=Position, description="target poses")
    vision: Vision = Field(default_factory=Vision, description="a camera's view")
    force: Force = Field(default_factory=Force, description="force control")
    following: Following = Field(default_factory=Following, description="a hand at the tool")
    spring: Spring = Field(default_factory=Spring, description="a virtual fixture")
    reflex: Reflex = Field(default_factory=Reflex, description="folding below what is ahead")

    @property
    def each(self) -> dict[str, Source]:
        """The sections by name, in the order in which rates are summed."""
        return {name: getattr(self, name) for name in SOURCES}


SOURCES = tuple(Sources.model_fields)
"""Names of the sources, in the order in which rates are summed."""


def _known(name: str) -> str:
    if name not in SOURCES:
        raise ValueError(f"no such source: the sources are {', '.join(SOURCES)}")
    return name


SourceName = Annotated[str, AfterValidator(_known)]
