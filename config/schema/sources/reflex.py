"""Schema of the source that folds an arm to what a scanner sees ahead."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from .source import SourceSection

Gain = Annotated[float, Field(ge=0, le=1)]


class ReflexSection(SourceSection):
    """Folding to pass below what is ahead: the tool's part of it, per axis of World."""

    NEEDS: ClassVar[Literal["contour"]] = "contour"

    gain: tuple[Gain, Gain, Gain, Gain, Gain, Gain] = Field(
        (1.0,) * 6,
        description="share of the tool's motion; 0: the tool stands, the elbow folds [1]",
    )
