"""Check of tasks that several mechanisms hold: grasps, load, and force control at each grasp."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ....config.load import Cell, grasp_part
from ....config.schema.joint_task import JointTaskSection
from ....server.control.arm.arm import Arm
from ....server.control.joint_task.joint_task import FIT_M, JointTask
from ..findings import Finding, Severity
from .stability import stability


def joint_tasks(cell: Cell) -> Iterator[Finding]:
    """Judge every joint task of a cell; none in a cell without any."""
    for section in cell.joint_tasks:
        yield _fit(cell, section)
        yield from _load(cell, section)
        for i, name in enumerate(section.by):
            for finding in stability(grasp_part(cell, section, i)):
                if finding.check.startswith("force"):
                    yield replace(finding, check=f"{section.name}.{name}.{finding.check}")


def _fit(cell: Cell, section: JointTaskSection) -> Finding:
    """Judge how far the grasps are from fitting each other at the posture `start`."""
    names = [part.config.mechanism.name for part in cell.parts]
    members = [names.index(name) for name in section.by]
    start = [np.array(cell.parts[i].config.mechanism.postures["start"]) for i in members]
    task = JointTask(section, [Arm.of(part) for part in cell.parts], members)
    off = task.grips.misfit(start)
    fits = Severity.OK if off <= FIT_M else Severity.ERROR if section.at_start else Severity.WARN
    return Finding(
        f"{section.name}.grasps",
        fits,
        f"{1e3 * off:.2g} mm from fitting each other at start, at most {1e3 * FIT_M:g} mm",
        {"misfit_m": off, "bound_m": FIT_M},
    )


def _load(cell: Cell, section: JointTaskSection) -> Iterator[Finding]:
    """Judge whether the arms can carry the payload: all of them together."""
    rated = [
        part.config.mechanism.rated_payload
        for part in cell.parts
        if part.config.mechanism.name in section.by
    ]
    if None in rated:
        return
    most = sum(mass for mass in rated if mass is not None)
    mass = section.payload.mass
    yield Finding(
        f"{section.name}.payload",
        Severity.OK if mass <= most else Severity.ERROR,
        f"{mass:g} kg, the arms are rated for {most:g} kg together",
        {"mass_kg": mass, "rated_kg": most},
    )
