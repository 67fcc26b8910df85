"""Check that a cell starts: its script, its physics, its shape, and room between its links."""

from collections.abc import Iterator

import numpy as np

from ....config.consistency import REQUIRED_POSTURES
from ....config.load import Cell, ConfigError
from ....drivers.rig.physics.scene import build_model
from ....server.control.proximity.capsules import Capsules
from ....server.control.proximity.pairs import PairSearch
from ...scripts.script import load_script
from ..findings import Finding, Severity


def starting(cell: Cell) -> Iterator[Finding]:
    """Judge what `simulate`, `demo` and `serve` begin with; each error as they would tell it."""
    try:
        script = load_script(cell.default_script)
        text = f"{cell.default_script.name}, {script.duration_s:g} s"
        yield Finding("script", Severity.OK, text, {"duration_s": script.duration_s})
    except ConfigError as error:
        yield from _told("script", error)
    if cell.config.rig is not None:
        try:
            model, _ = build_model(cell)
            yield Finding(
                "physics", Severity.OK, f"{model.nbody} bodies, {model.nv} degrees of freedom",
                {"bodies": int(model.nbody), "freedoms": int(model.nv)},
            )  # fmt: skip
        except ConfigError as error:
            yield from _told("physics", error)
    if not cell.config.keeps_clear:
        for part in cell.parts:
            links = part.robot.mesh_links()
            if links and part.config.rig is not None:
                yield Finding(
                    f"{part.prefix}shape",
                    Severity.WARN,
                    f"meshes are not read: {', '.join(links)} touch nothing in the rig, and no "
                    f"clearance is kept; `telerobot init {part.robot.urdf}` finds capsules",
                    {"links": len(links)},
                )
        return
    try:
        capsules = Capsules(cell)
    except ConfigError as error:
        yield from _told("shape", error)
        return
    yield from _own_gaps(cell, capsules)


def _own_gaps(cell: Cell, capsules: Capsules) -> Iterator[Finding]:
    """Judge the distance of each arm's links at `start` and `ready`."""
    avoidance = cell.config.avoidance
    search, room = PairSearch(cell, capsules), np.full(len(capsules.radius), 1.0)
    for name in REQUIRED_POSTURES:
        q = np.concatenate([part.config.mechanism.postures[name] for part in cell.parts])
        near = search.find(capsules.place(q[None]), None, room, 0.0)
        if not near.size:
            continue
        k = int(near.gap.argmin())
        gap, pair = (
            float(near.gap[k]),
            [capsules.links[int(i[k])] for i in (near.first, near.second)],
        )
        status = Severity.OK
        if gap < avoidance.self_clearance:
            status = Severity.ERROR if gap < 0.0 and avoidance.enabled else Severity.WARN
        yield Finding(
            f"links at {name}",
            status,
            f"{pair[0]} and {pair[1]} are {gap:.3g} m apart; {avoidance.self_clearance:g} m are "
            "promised",
            {"gap": gap, "clearance": avoidance.self_clearance},
        )


def _told(check: str, error: ConfigError) -> Iterator[Finding]:
    for message in error.messages:
        yield Finding(check, Severity.ERROR, message)
