"""The curve of a cell: its exterior, and its tunnels one after the other, with the gaps between."""

import math

import numpy as np

from .....config.drives.joint_bounds import joint_bounds
from .....config.errors import ConfigError
from .....config.load import Cell
from .....config.schema.mechanism.backbone import BackboneSection
from ...spatial import Array, Pose, rotation_exp
from .chain import Chain
from .curve import Curve
from .exterior import Bow, Chord
from .gaps import solve_gap
from .interior import Arcs, Turn
from .modal import Modal

NEAREST = 0.01
"""The entrance is at least so far from the first joint [m]."""
STRAIGHT = 1e-3
"""The entrance lies so well straight ahead of the first joint, in lengths of the way there [1]."""


def curve_of(cell: Cell, section: BackboneSection, chain: Chain) -> Curve:
    """Lay the curve of a cell's arm. Raises `ConfigError` for what the arm cannot follow."""
    where = f"{cell.path}: mechanism.backbone"
    T = Pose.from_xyz_rpy(section.entrance.xyz, section.entrance.rpy)
    ahead = T.p - chain.base
    h = float(np.linalg.norm(ahead))
    if h < NEAREST:
        raise ConfigError(
            f"{where}.entrance: {h:.4f} m from the first joint: must be at least {NEAREST:g}"
        )
    straight = chain.points(np.zeros((1, chain.n)))[0]
    out = straight[-1] - straight[0]
    aside = max(
        float(np.linalg.norm(ahead / h - T.R[:, 0])),
        float(np.linalg.norm(out / np.linalg.norm(out) - T.R[:, 0])),
    )
    if aside > STRAIGHT:
        raise ConfigError(
            f"{where}.entrance: must lie straight ahead of the first joint, along x: "
            f"{aside:.4f} rad off"
        )
    if section.least < 1.02 * h:
        raise ConfigError(
            f"{where}.least: value {section.least:g}: must be at least 1.02 times the way to "
            f"the entrance, {h:.4f} m: joints' speeds have no bound there"
        )
    if section.start > chain.length:
        raise ConfigError(
            f"{where}.start: value {section.start:g}: the arm is {chain.length:.4f} m long"
        )
    arcs = _arcs(T, section, chain, _range(cell), where)
    chord = Chord(chain.base, np.stack((T.R @ _bow(section), T.R[:, 0])), h)
    if section.exterior == "modal":
        return Curve(Modal(chord, np.array(section.modes)), arcs)
    return Curve(Bow(chord), arcs)


def centre_line(section: BackboneSection, step_m: float) -> list[list[Pose]]:
    """Return frames along what has walls, at most so far apart: a row for each without a gap.

    Their x is the tangent, y is to the left; in World.
    """
    T = Pose.from_xyz_rpy(section.entrance.xyz, section.entrance.rpy)
    rows = [[T]]
    for piece in section.tunnel:
        if piece.open:
            break
        if piece.to is not None:
            T = Pose.from_xyz_rpy(piece.to.xyz, piece.to.rpy)
            rows.append([T])
            continue
        count = math.ceil(piece.length / step_m)
        turn = np.array([0.0, -piece.climb, piece.bend]) / count
        angle = float(np.linalg.norm(turn))
        shorter = math.sin(0.5 * angle) / (0.5 * angle) if angle else 1.0
        half, whole = rotation_exp(0.5 * turn), rotation_exp(turn)
        for _ in range(count):
            # The chord of an arc points along the tangent in its middle.
            T = Pose(T.R @ whole, T.p + piece.length / count * shorter * (T.R @ half)[:, 0])
            rows[-1].append(T)
    return rows


def _range(cell: Cell) -> float:
    """Return what every joint can turn either way [rad]."""
    low, high = joint_bounds(cell.robot.joints, cell.config.mechanism.drives)
    return min(*(abs(x) for x in low), *(abs(x) for x in high))


def _arcs(T: Pose, section: BackboneSection, chain: Chain, most: float, where: str) -> Arcs:
    """Return the pieces of a tunnel one after the other, with the curves across its gaps.

    Raises `ConfigError` for a gap that no curve crosses whose joints turn less than `most` [rad].
    """
    links = np.diff(chain.stations, prepend=0.0)
    per_joint = float(links.max()) * (1.0 if section.axes == "planar" else 2.0)
    pieces: list[Arcs] = []
    for i, piece in enumerate(section.tunnel):
        turns = [Turn(piece.length, piece.bend, piece.climb)]
        if piece.to is not None:
            to = Pose.from_xyz_rpy(piece.to.xyz, piece.to.rpy)
            try:
                planar, sharpest = section.axes == "planar", most / per_joint
                turns = solve_gap(T, to, piece.length, planar, sharpest)
            except ValueError as error:
                raise ConfigError(f"{where}.tunnel[{i}].to: {error}") from None
        pieces.append(Arcs.from_entrance(T, turns))
        T = pieces[-1].end if piece.to is None else to
    return Arcs.of_all(pieces)


def _bow(section: BackboneSection) -> Array:
    """Return where the exterior bows out to (3,), in the entrance's frame."""
    angle = section.bow
    if angle is None:
        bend, climb = next(((s.bend, s.climb) for s in section.tunnel if s.bend or s.climb), (1, 0))
        angle = float(np.arctan2(-climb, -bend))
        if section.axes != "planar":
            angle += np.pi / 4
    return np.array([0.0, np.cos(angle), np.sin(angle)])
