"""Load shares of several grasps on one payload, and the internal forces among them.

Williams 1997, section 3: minimise Σ hᵢᵀWᵢhᵢ subject to Σ Gᵢhᵢ = w, by
hᵢ = Wᵢ⁻¹Gᵢᵀ (Σ GⱼWⱼ⁻¹Gⱼᵀ)⁻¹ w. Wrenches `[f; m]` are those that arms exert on the payload, each
at its own grasp, all in the axes of the MRF; w is their sum at the MRF.
"""

import numpy as np

from ..spatial import Array


def grasp_maps(p: Array) -> Array:
    """Return G (k, 6, 6) of grasps at p (k, 3) [m] seen from the MRF: G = [I 0; p̂ I]."""
    G = np.zeros((len(p), 6, 6))
    G[:, range(6), range(6)] = 1.0
    G[:, 3, 1], G[:, 3, 2] = -p[:, 2], p[:, 1]
    G[:, 4, 0], G[:, 4, 2] = p[:, 2], -p[:, 0]
    G[:, 5, 0], G[:, 5, 1] = -p[:, 1], p[:, 0]
    return G


def load_shares(G: Array, weights: Array, wrench: Array) -> Array:
    """Return each grasp's share (k, 6) of a wrench (6,) on the payload.

    G is (k, 6, 6); `weights` (k, 6) are the diagonals of W: the dearer, the less an arm carries.
    """
    shared = G.transpose(0, 2, 1) / weights[:, :, None]
    return np.asarray(shared @ np.linalg.solve((G @ shared).sum(axis=0), wrench))


def total(G: Array, exerted: Array) -> Array:
    """Return the wrench (6,) on the payload at the MRF, of those at the grasps (k, 6)."""
    return np.asarray((G @ exerted[:, :, None]).sum(axis=0)[:, 0])


def internal(G: Array, exerted: Array) -> Array:
    """Return what of the wrenches at the grasps (k, 6) moves nothing: less their least norm share.

    The weights are one, whatever shares the arms are to carry.
    """
    return exerted - load_shares(G, np.ones(exerted.shape), total(G, exerted))
