"""The sources that there are: one field each."""

from typing import Annotated

from pydantic import AfterValidator, Field

from ..section import Section
from .following import FollowingSection
from .force import ForceSection
from .joystick import JoystickSection
from .position import PositionSection
from .reflex import ReflexSection
from .source import SourceSection
from .spring import SpringSection
from .vision import VisionSection


class SourcesSection(Section):
    """Sources, which ask the tool for rates. All on at once; the rates add."""

    joystick: JoystickSection = Field(
        default_factory=JoystickSection, description="the operator's stick"
    )
    position: PositionSection = Field(default_factory=PositionSection, description="target poses")
    vision: VisionSection = Field(default_factory=VisionSection, description="a camera's view")
    force: ForceSection = Field(default_factory=ForceSection, description="force control")
    following: FollowingSection = Field(
        default_factory=FollowingSection, description="a hand at the tool"
    )
    spring: SpringSection = Field(default_factory=SpringSection, description="a virtual fixture")
    reflex: ReflexSection = Field(
        default_factory=ReflexSection, description="folding below what is ahead"
    )

    @property
    def each(self) -> dict[str, SourceSection]:
        """The sections by name, in the order in which rates are summed."""
        return {name: getattr(self, name) for name in SOURCES}


SOURCES = tuple(SourcesSection.model_fields)
"""Names of the sources, in the order in which rates are summed."""


def _known(name: str) -> str:
    if name not in SOURCES:
        raise ValueError(f"no such source: the sources are {', '.join(SOURCES)}")
    return name


SourceName = Annotated[str, AfterValidator(_known)]
