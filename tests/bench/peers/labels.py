"""Labels of feasible targets, judged beforehand by other means than the controllers.

A target is feasible if a posture with the tool at it is found (Newton from many random starts),
and a way there through joint space from the posture that reached the target before it
(RRT-Connect), both inside the joint limits and `CLEARANCE` away from everything. What swings counts
as standing everywhere that it swings through: such a way is free at any time, whoever waits for
whom. So *feasible* is a proof, by example; *not feasible* says that no example was found.
"""

import numpy as np
from telerobot.config.drives import joint_bounds
from telerobot.config.load import Cell
from telerobot.server.control.spatial import Array, Pose, pose_error

from ...oracle.random_tree import connected
from .geometry import PeerGeometry
from .scenes import PeerScene, Target

CLEARANCE = 0.03
"""Kept from things: the promise of 20 mm, and room to keep it with [m]."""
SELF_CLEARANCE = 0.02
"""Kept between links [m]."""
LIMIT_ROOM = 0.05
"""Kept from joint limits beyond the cell's margins [rad]."""
RESTARTS = 150
ENOUGH = 6
"""Postures that are looked for; ways are looked for to each of them in turn [1]."""
ITERATIONS = 40
CONVERGED = 1e-6

Draw = np.random.Generator


def room(cell: Cell) -> tuple[Array, Array]:
    """Return the joint angles (n,) [rad] that postures are looked for between."""
    bounds = joint_bounds(cell.robot.joints, cell.config.mechanism.drives, LIMIT_ROOM)
    return np.array(bounds.lower), np.array(bounds.upper)


def labelled(cell: Cell, scene: PeerScene, copies: int) -> PeerScene:
    """Return the scene with a label on each target; `copies` stand for each swing."""
    things = tuple(copy for thing in scene.things for copy in thing.swept(copies))
    geometry = PeerGeometry(cell, things)
    geometry.keep(CLEARANCE, SELF_CLEARANCE)
    draw = np.random.default_rng([scene.seed, 7])
    q = np.array(scene.start)
    found: list[Target] = []
    for target in scene.targets:
        reached, why = _reach(draw, cell, geometry, q, target.pose)
        feasible = reached is not None and all(t.feasible for t in found)
        if reached is not None:
            q = reached
            why = "" if feasible else "the target before it is not feasible"
        found.append(target.model_copy(update={"feasible": feasible, "why": why}))
    return scene.model_copy(update={"targets": tuple(found)})


def _reach(
    draw: Draw, cell: Cell, geometry: PeerGeometry, start: Array, T: Pose
) -> tuple[Array | None, str]:
    """Return a posture at T that a clear way leads to from `start`, or why there is none."""
    low, high = room(cell)
    postures: list[Array] = []
    for i in range(RESTARTS):
        seed = start if i == 0 else draw.uniform(low, high)
        q = _solved(geometry, T, seed, low, high)
        if q is not None and geometry.clear(q):
            postures.append(q)
        if len(postures) == ENOUGH:
            break
    if not postures:
        return None, "no clear posture found"
    postures.sort(key=lambda q: float(np.abs(q - start).max()))
    for q in postures:
        if connected(draw, geometry.clear, start, q, low, high):
            return q, ""
    return None, "no clear way found"


def _solved(geometry: PeerGeometry, T: Pose, q: Array, low: Array, high: Array) -> Array | None:
    """Return a posture inside the limits with the tool at T, by damped Newton steps from q."""
    for _ in range(ITERATIONS):
        error = pose_error(T, geometry.tool(q))
        if np.abs(error).max() < CONVERGED:
            return q
        J = geometry.jacobian(q)
        step = J.T @ np.linalg.solve(J @ J.T + 1e-4 * float(error @ error) * np.eye(6), error)
        q = np.clip(q + step * min(1.0, 0.5 / float(np.abs(step).max())), low, high)
    return None
