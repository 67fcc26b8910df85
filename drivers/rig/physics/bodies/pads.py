"""Springs of the pads between the last links of arms and the payload that they hold."""

import math

import numpy as np
from numpy.typing import NDArray

from .....server.control.compiled import ARRAY3, INDEX, MATRIX, TABLE, VECTOR, compiled, record

Vector = NDArray[np.float64]


@compiled(
    record(TABLE, TABLE, TABLE), INDEX, MATRIX, record(MATRIX, ARRAY3),
    record(MATRIX, ARRAY3, VECTOR), VECTOR, TABLE, TABLE, TABLE,
)  # fmt: skip
def pull_pads(
    places: tuple[Vector, Vector, Vector],
    bodies: NDArray[np.int64],
    twists: Vector,
    tips: tuple[Vector, Vector],
    pads: tuple[Vector, Vector, Vector],
    gains: Vector,
    wrenches: Vector,
    apart: Vector,
    forces: Vector,
) -> None:
    """Fill in the pads' wrenches and what they are apart (k, 3), and add to all bodies' forces.

    `places` are MuJoCo's xpos, xmat and xipos, `bodies` the payload and the last links (k + 1,),
    `twists` theirs (k + 1, 6), angular part first; `tips` are places and attitudes of the pads in
    the last links, `pads` those on the payload, and whether they are closed; `gains` (4,) are
    stiffness [N/m, N·m/rad] and damping [N·s/m, N·m·s/rad].
    """
    xpos, xmat, xipos = places
    p_tip, R_tip = tips
    p, R_pad, closed = pads
    body = bodies[0]
    R, com = xmat[body], xipos[body]
    for i in range(len(bodies) - 1):
        tip = bodies[i + 1]
        v, own, T = twists[i + 1], twists[0], xmat[tip]
        at, arm, lever = np.empty(3), np.empty(3), np.empty(3)
        turned, force, moment = np.empty((3, 3)), np.empty(3), np.empty(3)
        for j in range(3):
            at[j] = xpos[body, j]
            way = xpos[tip, j] - xpos[body, j]
            for c in range(3):
                at[j] += R[3 * j + c] * p[i, c]
                way += T[3 * j + c] * p_tip[i, c]
            force[j] = way  # where the pad is, seen from the payload's origin, in World
            arm[j], lever[j] = at[j] - com[j], at[j] - xipos[tip, j]
        for j in range(3):
            apart[i, j] = -p[i, j]
            for c in range(3):
                apart[i, j] += R[3 * c + j] * force[c]
        for j in range(3):  # the pad's attitude on the payload, less the one that fits
            for c in range(3):
                turned[j, c] = 0.0
                for a in range(3):
                    for b in range(3):
                        fits = R_tip[i, b, 0] * R_pad[i, c, 0] + R_tip[i, b, 1] * R_pad[i, c, 1]
                        fits += R_tip[i, b, 2] * R_pad[i, c, 2]
                        turned[j, c] += R[3 * a + j] * T[3 * a + b] * fits
        half = np.empty(3)
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            half[j] = 0.5 * (turned[b, a] - turned[a, b])
        sine = math.sqrt(half[0] ** 2 + half[1] ** 2 + half[2] ** 2)
        cosine = 0.5 * (turned[0, 0] + turned[1, 1] + turned[2, 2] - 1.0)
        scale = math.atan2(sine, cosine) / sine if sine > 1e-12 else 1.0
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            # What the pad moves, relative to the payload, in World.
            force[j] = v[3 + j] + v[a] * lever[b] - v[b] * lever[a]
            force[j] -= own[3 + j] + own[a] * arm[b] - own[b] * arm[a]
            moment[j] = v[j] - own[j]
        for j in range(3):
            linear, angular = gains[0] * apart[i, j], gains[1] * scale * half[j]
            for c in range(3):
                linear += gains[2] * R[3 * c + j] * force[c]
                angular += gains[3] * R[3 * c + j] * moment[c]
            wrenches[i, j], wrenches[i, 3 + j] = closed[i] * linear, closed[i] * angular
        for j in range(3):
            force[j] = moment[j] = 0.0
            for c in range(3):
                force[j] += R[3 * j + c] * wrenches[i, c]
                moment[j] += R[3 * j + c] * wrenches[i, 3 + c]
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            forces[body, j] += force[j]
            forces[body, 3 + j] += moment[j] + arm[a] * force[b] - arm[b] * force[a]
            forces[tip, j] -= force[j]
            forces[tip, 3 + j] -= moment[j] + lever[a] * force[b] - lever[b] * force[a]
