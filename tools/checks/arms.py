"""Check of several arms: that they keep clear of each other, and do so in their postures."""

from collections.abc import Iterator

import numpy as np

from ...config.consistency import REQUIRED_POSTURES
from ...config.load import Cell
from ...server.control.proximity.capsules import Capsules
from ...server.control.proximity.pairs import PairSearch
from .findings import Finding, Severity

FARTHEST = 10.0
"""Arms that are farther apart count as this far [m]."""


def arms(cell: Cell) -> Iterator[Finding]:
    """Judge the distance between arms where all of them are at `start`, and at `ready`."""
    if len(cell.parts) < 2:
        return
    avoidance = cell.config.avoidance
    if not avoidance.enabled:
        text = "avoidance.enabled is false: nothing keeps the arms clear of each other at start"
        yield Finding("arms apart", Severity.WARN, text, {"enabled": False})
    capsules = Capsules(cell)
    for name in REQUIRED_POSTURES:
        q = np.concatenate([part.config.mechanism.postures[name] for part in cell.parts])
        gap, pair = _nearest(cell, capsules, q)
        least = avoidance.self_clearance
        status, room = Severity.OK, least + avoidance.margin
        if gap < least:
            status = Severity.ERROR if name == "start" else Severity.WARN
        elif gap < room:
            status = Severity.WARN
        where = f"{pair[0]} and {pair[1]}" if pair else "all"
        far = f"at least {gap:.3g}" if gap == FARTHEST else f"{gap:.3g}"
        yield Finding(
            f"arms at {name}",
            status,
            f"{where} are {far} m apart; {least:g} m are promised, with a margin {room:g} m",
            {"gap": gap, "clearance": least, "margin": avoidance.margin},
        )


def _nearest(cell: Cell, capsules: Capsules, q: np.ndarray) -> tuple[float, tuple[str, ...]]:
    """Return the least distance between links of two arms at q (n,) [m], and which links."""
    search, room = PairSearch(cell, capsules), np.full(len(capsules.radius), FARTHEST)
    near = search.find(capsules.place(q[None]), None, room, 0.0)
    root, body, links = capsules.forest.root, capsules.body, capsules.links
    found: tuple[float, tuple[str, ...]] = (FARTHEST, ())
    for first, second, gap in zip(near.first, near.second, near.gap, strict=True):
        if root(int(body[first])) != root(int(body[second])) and gap < found[0]:
            found = float(gap), (links[first], links[second])
    return found
