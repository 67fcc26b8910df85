"""Check of postures: distance from singularities at the start."""

from collections.abc import Iterator

import numpy as np

from ....config.consistency import REQUIRED_POSTURES
from ....config.load import Cell
from ....server.control.mechanism.model import Mechanism
from ....server.control.spatial import Pose
from ..findings import Finding, Severity


def postures(cell: Cell) -> Iterator[Finding]:
    """Judge the least singular value at `start` and `ready`; joint limits were held on loading."""
    config = cell.config.mechanism
    mechanism = Mechanism.from_cell(cell)
    tool = Pose.from_xyz_rpy(config.T_wrist_mrf.xyz, config.T_wrist_mrf.rpy)
    resolve = cell.config.resolve
    weight = np.array([1.0] * 3 + [resolve.characteristic_length] * 3)
    for name in REQUIRED_POSTURES:
        J = mechanism.kinematics(np.array(config.postures[name]), tool).J
        # Axes that the arm reaches nowhere, as a planar one, are no singularities.
        each = np.linalg.svd(J * weight[:, None], compute_uv=False)
        sigma = float(each[min(mechanism.rank, len(each)) - 1])
        status, judgement = Severity.OK, "away from"
        if sigma < resolve.floor:
            status, judgement = Severity.ERROR, "in"
        elif sigma < resolve.singular_region:
            status, judgement = Severity.WARN, "near"
        yield Finding(
            f"posture {name}",
            status,
            f"{judgement} a singularity: least singular value {sigma:.3g} m, damping begins below "
            f"{resolve.singular_region:g}, motion into it ends at {resolve.floor:g}",
            {"sigma_min": sigma, "singular_region": resolve.singular_region},
        )
