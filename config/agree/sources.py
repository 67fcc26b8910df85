"""Needs of the sources in the cell's other sections."""

from collections.abc import Iterator

from ..schema.cell import CellConfig


def source_disagreements(config: CellConfig) -> Iterator[str]:
    """Yield what does not fit, each in one line with its key."""
    has = {
        "force_torque": config.mechanism.force_torque is not None,
        "camera": bool(config.cameras),
        "contour": config.contour is not None,
        "base": config.frames.base is not None,
        "carrier": config.frames.carrier is not None,
    }
    there = frozenset(name for name, given in has.items() if given)
    for name, section in config.sources.each.items():
        for complaint in section.lacking(there):
            yield f"sources.{name}.{complaint}"
