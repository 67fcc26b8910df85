"""Distances from points to solids, and the way out: what `spread_link` needs of their shape."""

import numpy as np

from ..frames import Array

_NONE = 1e-12


def round_solids(x: Array, start: Array, end: Array, radius: Array) -> tuple[Array, Array]:
    """Return distance (o, p) and outward normal (3, o, p) of points x (3, p) to rounded segments.

    Segments from `start` to `end` (3, o), thick by `radius` (o,) [m]; a sphere's ends coincide.
    """
    along = end - start
    length2 = np.maximum((along * along).sum(axis=0), _NONE)
    away = x[:, None, :] - start[:, :, None]
    part = np.clip((away * along[:, :, None]).sum(axis=0) / length2[:, None], 0.0, 1.0)
    away -= part * along[:, :, None]
    size = np.sqrt((away * away).sum(axis=0))
    return size - radius[:, None], away / np.maximum(size, _NONE)


def boxes(x: Array, centre: Array, R: Array, half: Array) -> tuple[Array, Array]:
    """Return distance (o, p) and outward normal (3, o, p) of points x (3, p) to boxes.

    Boxes are at `centre` (3, o), `half` (3, o) their half sides along the columns of R (o, 3, 3).
    Inside, the nearest face counts, its distance negative.
    """
    local = np.einsum("oij,iop->jop", R, x[:, None, :] - centre[:, :, None])
    beyond = np.abs(local) - half[:, :, None]
    outside = np.maximum(beyond, 0.0)
    size = np.sqrt((outside * outside).sum(axis=0))
    deepest = beyond.max(axis=0)
    within = size <= 0.0
    way = np.where(within, beyond >= deepest, outside / np.maximum(size, _NONE))
    normal = np.einsum("oij,jop->iop", R, np.copysign(way, local))
    return np.where(within, deepest, size), normal
