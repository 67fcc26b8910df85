"""Agreement between the parts of a cell: its mechanisms, and the buses that they share."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from ..errors import ConfigError, nearest
from ..schema.bus.on_bus import Entry
from ..schema.cell import CellConfig
from ..urdf.robot import Robot
from .buses import bus_disagreements
from .obstacles import link_disagreements


class PartOf(NamedTuple):
    """One mechanism of a cell: its place in the file, and what the file says of it."""

    place: str
    prefix: str
    """Prefix of the names of its links and devices."""
    config: CellConfig
    robot: Robot


Parts = Sequence[PartOf]


def check_cell(path: Path, parts: Parts, devices: Sequence[Entry]) -> None:
    """Raise `ConfigError`, of all disagreements found, each naming the file and the key."""
    found = list(_disagreements(parts, devices))
    if found:
        raise ConfigError(*(f"{path}: {text}" for text in found))


def _disagreements(parts: Parts, devices: Sequence[Entry]) -> Iterator[str]:
    first = parts[0].config
    yield from bus_disagreements([(p.place, p.config) for p in parts], devices)
    yield from link_disagreements(first, [(p.prefix, p.robot) for p in parts])
    yield from _standing(parts)
    yield from _cameras(parts)
    yield from _rovers(parts)
    rigs = [part.config.rig is not None for part in parts]
    if any(rigs) and not all(rigs):
        place = parts[rigs.index(False)].place
        yield f"{place}.rig: missing: other mechanisms of the cell are simulated"


def _standing(parts: Parts) -> Iterator[str]:
    """Judge which mechanism stands on which."""
    on = {part.config.mechanism.name: part.config.mechanism.on for part in parts}
    for part in parts:
        place, mechanism = part.place, part.config.mechanism
        under = mechanism.on
        if under is None:
            if mechanism.T_on is not None:
                yield f"{place}.T_on: there is no {place}.on that says what it stands on"
            continue
        where = f"{place}.on: value '{under}'"
        if under not in on:
            yield f"{where}: no such mechanism{nearest(under, list(on))}"
        way = [mechanism.name]
        while (below := on.get(way[-1])) is not None and below not in way:
            way.append(below)
        if below is not None:
            yield f"{where}: goes round in a circle: {' on '.join((*way, below))}"
        yield f"{where}: a mechanism that stands on another one is not supported yet"


def _rovers(parts: Parts) -> Iterator[str]:
    """A base that drives, and a scanner, have the cell for themselves."""
    if len(parts) == 1:
        return
    shared = parts[0].config
    for part in parts:
        if part.config.mechanism.base is not None:
            yield (
                f"{part.place}.base: a mechanism on wheels must be the only one of its cell, which "
                f"has {len(parts)}: give each rover a cell of its own, and tell it of the others "
                "as obstacles"
            )
    for key in ("scanner", "contour"):
        if getattr(shared, key) is not None:
            yield f"{key}: looks ahead of one mechanism: the cell has {len(parts)}"


def _cameras(parts: Parts) -> Iterator[str]:
    """Pictures are told by the camera's name, whichever task it is of."""
    seen: dict[str, str] = {}
    for part in parts:
        name = part.config.mechanism.name
        for camera in part.config.cameras:
            if camera.name in seen:
                yield (
                    f"tasks: camera '{camera.name}' of mechanism '{name}' is also one of "
                    f"'{seen[camera.name]}': give one another name"
                )
            seen[camera.name] = name
    rig = parts[0].config.rig
    for i, tag in enumerate(() if rig is None else rig.tags):
        if tag.T_wrist_tag is not None and len(parts) > 1:
            yield f"rig.tags[{i}].T_wrist_tag: there are several mechanisms: tags stand in World"
