"""Schema of an enabling switch (IEC 60204-1, 10.9)."""

from typing import Annotated

from pydantic import Field

from .on_bus import BusFrames, CanOpenNodeSection


class EnablingSwitchSection(CanOpenNodeSection):
    """A hold-to-run switch on digital inputs of a CiA 401 module: released, the arm stands."""

    inputs: tuple[Annotated[int, Field(ge=0, le=7)], ...] = Field(
        (0, 1),
        min_length=1,
        max_length=8,
        description="bits of 6000h:01, one for each contact: it is held while all of them are on",
    )

    def frames(self, operation_mode: str) -> tuple[BusFrames, ...]:  # noqa: ARG002  it has none
        """Return its answer to SYNC."""
        return (BusFrames(1),)
