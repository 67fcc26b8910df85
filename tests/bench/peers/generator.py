"""Random scenes by seed: an arm at rest, things around it and in its way, targets to reach.

Equal seeds give equal scenes. Nothing of the controllers under test is used: postures are drawn,
and their clearances measured on the arm's real shapes.
"""

import numpy as np
from telerobot.config.load import Cell
from telerobot.server.control.spatial import Array

from .geometry import PeerGeometry
from .labels import SELF_CLEARANCE, labelled, room
from .scenes import PeerScene, Target, Thing

TARGETS = 2
TRIES = 400
KEPT_CLEARANCE = 0.05
"""Things keep it from the start and from most targets, wherever they swing to [m]."""
REACH = (0.2, 0.9)
"""Targets lie so far from the pose before [m]."""
TURN = 1.6
"""Targets are turned at most so far from the pose before [rad]."""
UNCHECKED = 0.2
"""Part of the targets that things may stand on [1]."""
STANDING = (5, 11)
MOVING = (1, 3)
"""Fewest and most things of each kind."""
WITH_MOTION = 0.5
"""Part of the scenes in which something moves [1]."""
BESIDE = 0.7
"""Part of the things that are put near the tool's way [1]."""
ASIDE = 0.12
"""Standard deviation of their distance from it, per axis [m]."""
SPREAD = 0.6
"""Postures are drawn within this part of the joints' ranges [1]."""
SWING = (0.05, 0.15)
"""Amplitudes [m]."""
SPEED = (0.03, 0.15)
"""Greatest speeds of what swings [m/s]."""
COPIES = 7
"""Places that stand for all of a swing: at most a third of its amplitude apart [1]."""

Draw = np.random.Generator


def generate(cell: Cell, seed: int) -> PeerScene:
    """Return the scene of a seed, its targets labelled."""
    draw = np.random.default_rng([seed, *cell.config.name.encode()])
    empty = PeerGeometry(cell, ())
    empty.keep(0.0, SELF_CLEARANCE)
    postures = [_posture(draw, cell, empty)]
    for _ in range(TARGETS):
        postures.append(_next(draw, cell, postures[-1], empty))
    kept = [postures[0], *(q for q in postures[1:] if draw.random() > UNCHECKED)]
    tools = [empty.tool(q).to_xyz_rpy() for q in postures[1:]]
    scene = PeerScene(
        seed=seed,
        cell=cell.config.name,
        start=tuple(postures[0].tolist()),
        things=tuple(_things(draw, cell, postures, kept, empty)),
        targets=tuple(Target(xyz=T[:3], rpy=T[3:]) for T in tools),
    )
    return labelled(cell, scene, COPIES)


def _posture(draw: Draw, cell: Cell, geometry: PeerGeometry) -> Array:
    """Return a posture that keeps its clearances and has the tool above the floor."""
    low, high = room(cell)
    middle, half = 0.5 * (low + high), 0.5 * SPREAD * (high - low)
    for _ in range(TRIES):
        q = middle + half * draw.uniform(-1.0, 1.0, len(low))
        if geometry.tool(q).p[2] > 0.2 and geometry.clear(q):
            return q
    raise RuntimeError(f"{cell.config.name}: no clear posture in {TRIES} tries")


def _next(draw: Draw, cell: Cell, before: Array, geometry: PeerGeometry) -> Array:
    """Return a posture whose tool pose is some way off the one before."""
    low, high = room(cell)
    T = geometry.tool(before)
    q = before
    for _ in range(TRIES):
        q = np.clip(before + draw.uniform(-1.0, 1.0, len(low)), low, high)
        found = geometry.tool(q)
        away = float(np.linalg.norm(found.p - T.p))
        turn = float(np.arccos(np.clip(0.5 * (np.trace(T.R.T @ found.R) - 1.0), -1.0, 1.0)))
        near = REACH[0] < away < REACH[1] and turn < TURN
        if near and found.p[2] > 0.2 and geometry.clear(q):
            return q
    return q


def _things(
    draw: Draw, cell: Cell, postures: list[Array], kept: list[Array], empty: PeerGeometry
) -> list[Thing]:
    """Return things, most of them in or beside the way from posture to posture.

    Each is clear of the postures that are `kept`, wherever it swings to.
    """
    kinds = [False] * int(draw.integers(*STANDING, endpoint=True))
    if draw.random() < WITH_MOTION:
        kinds += [True] * int(draw.integers(*MOVING, endpoint=True))
    things: list[Thing] = []
    for i, moving in enumerate(kinds):
        for _ in range(TRIES):
            if draw.random() < BESIDE:
                leg = int(draw.integers(len(postures) - 1))
                way = postures[leg + 1] - postures[leg]
                q = postures[leg] + draw.uniform(0.1, 0.9) * way
                centre = empty.tool(q).p + draw.normal(0.0, ASIDE, 3)
            else:
                centre = np.append(draw.uniform(-0.9, 0.9, 2), draw.uniform(0.1, 1.3))
            thing = _thing(draw, f"thing_{i}", centre, moving)
            copies = PeerGeometry(cell, thing.swept(COPIES))
            copies.keep(KEPT_CLEARANCE, 0.0)
            if _beside_base(thing) and all(copies.clear(q) for q in kept):
                things.append(thing)
                break
    return things


def _beside_base(thing: Thing) -> bool:
    """Return whether a thing leaves room for the base and the shoulder, which cannot evade it."""
    size = thing.radius + thing.half_length + float(np.linalg.norm(thing.half_size))
    size += float(np.linalg.norm(thing.swing))
    x, y, z = thing.xyz
    return float(np.hypot(x, y)) > size + 0.2 or z > size + 0.6


def _thing(draw: Draw, name: str, centre: Array, moving: bool) -> Thing:
    shape = ("sphere", "capsule", "box")[int(draw.integers(3))]
    a, b, c = centre.tolist()
    swing, frequency = (0.0, 0.0, 0.0), 0.0
    if moving:
        way = draw.normal(0.0, 1.0, 3)
        amplitude = float(draw.uniform(*SWING))
        x, y, z = (amplitude * way / np.linalg.norm(way)).tolist()
        swing, frequency = (x, y, z), float(draw.uniform(*SPEED)) / amplitude
    roll, pitch, yaw = draw.uniform(-np.pi, np.pi, 3).tolist()
    sides = draw.uniform(0.02, 0.12, 3).tolist()
    return Thing(
        name=name,
        shape=shape,
        xyz=(a, b, c),
        rpy=(0.0, 0.0, 0.0) if shape == "sphere" else (roll, 0.5 * pitch, yaw),
        radius=0.0 if shape == "box" else float(draw.uniform(0.03, 0.10)),
        half_length=float(draw.uniform(0.05, 0.25)) if shape == "capsule" else 0.0,
        half_size=(sides[0], sides[1], sides[2]) if shape == "box" else (0.0, 0.0, 0.0),
        swing=swing,
        frequency=frequency,
        phase=float(draw.uniform(0.0, 2.0 * np.pi)),
    )
