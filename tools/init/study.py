"""What an arm can do, by its model: postures, clear ways; where its tool is, and how it points."""

import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from ...config.drives import joint_bounds
from ...config.load import Cell
from ...config.urdf.shapes import Array, Tube
from ...server.control.mechanism.model import Mechanism
from ...server.control.proximity.capsules import Capsules
from ...server.control.proximity.distance import measured
from ...server.control.scene import empty
from ...server.control.spatial import Pose
from .draft import HOLDS, Draft

# --- Search in a cell's own model: free postures, ways of the tool, what always overlaps ----------
NEIGHBOURS: Final = 2  # links so many joints apart, or fewer, may overlap
ALWAYS: Final = 0.5  # links that overlap in more of all postures than this are built so [1]
APART: Final = 0.03  # distance that links have in a posture that is found [m]
TOUCHING: Final = 0.012  # links that are nearer count as overlapping: clearance and margin [m]
_DRAWN: Final = 4000
_LOOKED_AT: Final = 400
_ENOUGH: Final = 40  # free postures are looked for until there are so many [1]
GRANTED: Final = 0.25
"""Part of a straight way that the tool goes at least, where the arm cannot keep its angles [1]."""
AT_LIMIT: Final = 0.02  # a joint that is nearer to a limit is at it [rad]
_CROSSED: Final = 200  # postures of several arms that are looked at [1]
_STEP: Final = 0.005  # of a way that is tried [m]


class GradedPosture(NamedTuple):
    """A posture, and how good it is."""

    q: Array
    sigma: float  # least singular value, of the axes that the arm reaches [m]


class Study:
    """One arm's kinematics and capsules, and what stands beside it."""

    def __init__(self, cell: Cell, length: float, beside: Sequence[Tube] = ()) -> None:
        self.cell, self.beside = cell, bool(beside)
        self.mechanism = Mechanism.from_cell(cell)
        self.capsules = Capsules(cell)
        config = cell.config.mechanism
        self.tool = Pose.from_xyz_rpy(config.T_wrist_mrf.xyz, config.T_wrist_mrf.rpy)
        self.lower, self.upper = (
            np.array(b) for b in joint_bounds(cell.robot.joints, config.drives)
        )
        self._weight = np.array([1.0] * 3 + [length] * 3)
        contacts = {(c.link, c.other) for c in cell.config.avoidance.allowed_contacts}
        self.links, moves = self.capsules.links, self.capsules.moves
        pairs = [
            (i, j)
            for j in range(len(self.links))
            for i in range(j)
            if int((moves[i] ^ moves[j]).sum()) > NEIGHBOURS
            and not {(self.links[i], self.links[j]), (self.links[j], self.links[i])} & contacts
        ]
        self._pairs = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        rods = np.array([[s.start, s.end] for s in beside]).reshape(-1, 2, 3)
        self._solids = (rods[:, 0].copy(), rods[:, 1].copy(), *empty().segments[2:])
        moved = np.flatnonzero(self._far())
        self._beside = np.array(
            [(i, len(self.links) + k) for i in moved for k in range(len(rods))], dtype=np.int64
        ).reshape(-1, 2)
        self._radii = np.concatenate([self.capsules.radius, [s.radius for s in beside]])

    def drawn(self, count: int = _DRAWN) -> Array:
        """Return postures (count, n) inside the limits, some way from them."""
        span = np.minimum(self.upper, math.pi) - np.maximum(self.lower, -math.pi)
        wide = span > 0.0
        low = np.where(wide, np.maximum(self.lower, -math.pi), self.lower)
        high = np.where(wide, np.minimum(self.upper, math.pi), self.upper)
        room = 0.12 * (high - low)
        draw = np.random.default_rng(1)
        return np.asarray(draw.uniform(low + room, high - room, size=(count, len(low))))

    def overlapping(self) -> list[tuple[str, str]]:
        """Return the links that overlap almost everywhere: they are built so."""
        postures = self.drawn(200)
        gaps = np.array([self._gaps(q) for q in postures]).reshape(len(postures), -1)
        gaps = gaps[:, : len(self._pairs)]
        often = (gaps < TOUCHING).mean(axis=0) > ALWAYS
        named = {(self.links[a], self.links[b]) for a, b in self._pairs[often].tolist()}
        return sorted({(min(pair), max(pair)) for pair in named if pair[0] != pair[1]})

    def gap(self, q: Array) -> float:
        """Return the least distance of two links at a posture [m]."""
        gaps = self._gaps(q)
        return float(gaps.min()) if len(gaps) else math.inf

    def sigma(self, q: Array) -> float:
        """Return the least singular value at a posture, of the axes that are reached [m]."""
        J = self.mechanism.kinematics(q, self.tool).J * self._weight[:, None]
        each = np.linalg.svd(J, compute_uv=False)
        return float(each[min(self.mechanism.rank, len(each)) - 1])

    def tool_pose(self, q: Array) -> Pose:
        """Return the MRF's pose in World."""
        return self.mechanism.kinematics(q, self.tool).T_world_mrf

    def ends(self, q: Array) -> Array:
        """Return the capsules' ends (c, 2, 3) in World [m]."""
        return np.asarray(self.capsules.place(q[None]).ends[0])

    def good(self, direction: Array, torques: Array) -> Iterator[GradedPosture]:
        """Yield free postures, the best first, whose tool looks along `direction` (3,) of the MRF.

        Away from singularities and limits; the tool level and outward, the arm above its Base, and
        gravity below half of `torques` (n,), as far as that can be had, and always below `HOLDS`.
        """
        postures = self.drawn()
        sigma = np.array([self.sigma(q) for q in postures])
        poses = [self.tool_pose(q) for q in postures]
        p = np.array([T.p for T in poses]) - self.mechanism.T_world_base.p
        d = np.array([T.R @ direction for T in poses])
        flat = p[:, :2] / np.maximum(np.linalg.norm(p[:, :2], axis=1), 1e-6)[:, None]
        reach = float(np.linalg.norm(p, axis=1).max())
        score = sigma / max(float(sigma.max()), 1e-12)
        score += 0.3 * (1.0 - np.abs(d[:, 2])) + 0.3 * (d[:, :2] * flat).sum(axis=1)
        score -= 0.5 * self.edge(postures)
        score -= 1.0 * (p[:, 2] < 0.15 * reach) + 0.5 * (np.linalg.norm(p, axis=1) > 0.9 * reach)
        order = np.argsort(-score, kind="stable")
        kept: list[tuple[float, int]] = []
        for tried, i in enumerate(order.tolist()):
            if tried >= _LOOKED_AT and len(kept) >= _ENOUGH:
                break
            q = postures[i]
            if self.gap(q) < APART:
                continue
            weight = self.weight(q) / torques
            if float(weight.max()) > HOLDS:
                continue
            low = float(self.ends(q)[self._far(), :, 2].min(initial=0.0))
            penalty = 2.0 * max(0.0, float(weight.max()) - 0.5) + 2.0 * max(0.0, -low)
            if self.mechanism.rank < 6:  # a push is as straight as the arm can go
                penalty += 1.0 - self.granted(q, np.concatenate([d[i], np.zeros(3)]))
            kept.append((float(score[i]) - penalty, i))
        for _, i in sorted(kept, reverse=True):
            yield GradedPosture(postures[i], float(sigma[i]))

    def edge(self, postures: Array) -> Array:
        """Return how far postures (p, n) are from the middles of their joints' ranges (p,), 0 to 1.

        The mean over all joints, and what the farthest has beyond 0.6 of its way to a bound.
        """
        low, high = np.maximum(self.lower, -math.pi), np.minimum(self.upper, math.pi)
        half = np.maximum(0.5 * (high - low), 1e-9)
        off = np.abs(postures - 0.5 * (low + high)) / half
        beyond = np.maximum(off.max(axis=1) - 0.6, 0.0) / 0.4
        return np.asarray(0.5 * off.mean(axis=1) + beyond)

    def weight(self, q: Array) -> Array:
        """Return the size of the torques (n,) that hold the arm against gravity [N·m]."""
        return np.abs(self.mechanism.gravity(q)[0])

    def walk(self, q: Array, twist: Array, length: float, least: float) -> Array | None:
        """Return where a straight way of the tool ends, `twist` (6,) a metre, or None.

        None where it would meet a limit, the arm itself, or a singular value below `least` [m], or
        where an arm of fewer than six axes would go less than `GRANTED` of the way.
        """
        steps = max(1, round(length / _STEP))
        for _ in range(steps):
            J = self.mechanism.kinematics(q, self.tool).J * self._weight[:, None]
            wanted = twist * self._weight * (length / steps)
            moved = J.T @ np.linalg.solve(J @ J.T + 1e-8 * np.eye(6), wanted)
            if float(wanted @ (J @ moved)) < GRANTED * float(wanted @ wanted):
                return None
            q = q + moved
            if self.outside(q) or self.sigma(q) < least or self.gap(q) < APART / 2:
                return None
        return q

    def granted(self, q: Array, twist: Array) -> float:
        """Return the part of a twist (6,) that the arm goes at a posture [1]: 1 with six axes."""
        J = self.mechanism.kinematics(q, self.tool).J * self._weight[:, None]
        wanted = twist * self._weight
        went = J @ (J.T @ np.linalg.solve(J @ J.T + 1e-8 * np.eye(6), wanted))
        return float(wanted @ went) / float(wanted @ wanted)

    def free(self, a: Array, b: Array) -> bool:
        """Return whether the straight way between two postures is free of the arm itself."""
        return all(
            self.gap(a + s * (b - a)) > APART / 2 and not self.outside(a + s * (b - a))
            for s in np.linspace(0.0, 1.0, 20)
        )

    def outside(self, q: Array) -> bool:
        """Return whether a joint is at a limit."""
        return bool((q < self.lower + AT_LIMIT).any() or (q > self.upper - AT_LIMIT).any())

    def _far(self) -> Array:
        """Return which capsules more than two joints move (c,)."""
        return np.asarray(self.capsules.moves.sum(axis=1) > 2)

    def _gaps(self, q: Array) -> Array:
        """Return the distances of its own links, and of what stands beside it [m]."""
        pairs = np.concatenate([self._pairs, self._beside])
        if not len(pairs):
            return np.zeros(0)
        ends = self.capsules.place(q[None]).ends
        apart = measured(ends, (pairs[:, 0], pairs[:, 1]), self._solids)[0]
        return np.asarray(apart - self._radii[pairs].sum(axis=1))


def by_design(cell: Cell) -> list[tuple[str, str]]:
    """Return the links of different arms on one base that overlap because they are built so.

    Those that two joints or fewer part, wherever they do; others, where they do mostly.
    """
    capsules, draw = Capsules(cell), np.random.default_rng(3)
    forest, links, moves = capsules.forest, capsules.links, capsules.moves
    roots = [forest.root(int(body)) for body in capsules.body]
    found = [
        (i, j)
        for j in range(len(links))
        for i in range(j)
        if roots[i] != roots[j] and (moves[i] ^ moves[j]).any()
    ]
    if not found:
        return []
    pairs = np.array(found, dtype=np.int64)
    low, high = (
        np.clip(np.concatenate(bounds), -math.pi, math.pi)
        for bounds in zip(
            *(joint_bounds(p.robot.joints, p.config.mechanism.drives) for p in cell.parts),
            strict=True,
        )
    )
    ends = capsules.place(draw.uniform(low, high, (_CROSSED, len(low)))).ends
    radii = capsules.radius[pairs].sum(axis=1)
    meet = np.array(
        [
            measured(at[None].copy(), (pairs[:, 0], pairs[:, 1]), empty().segments)[0] - radii
            < TOUCHING
            for at in ends
        ]
    )
    near = np.array([int((moves[i] ^ moves[j]).sum()) <= NEIGHBOURS for i, j in pairs.tolist()])
    built = np.where(near, meet.any(axis=0), meet.mean(axis=0) > ALWAYS)
    return sorted({(links[i], links[j]) for i, j in pairs[built].tolist()})


# --- Place of the tool: from which face of the arm's last link it looks outward -------------------
BALL: Final = 0.012  # radius of the tool's ball [m]
STANDS_OUT: Final = 0.02  # the ball stands out from the arm by so much [m]
AT_THE_JOINT: Final = 0.02  # a tip link that is nearer to the last joint has its frame in it [m]
_TURNS: Final = 8  # angles of the last joint that the arm before it is looked at from [1]


class ToolSide:
    """The last body of an arm, as seen from its tip link."""

    def __init__(self, draft: Draft, study: Study) -> None:
        """Look at the capsules of the tip's body, and at those of the body before it."""
        forest = study.capsules.forest
        self._draft = draft
        body, T_body_tip = forest.body_of(draft.arm.tip)
        self._joint = -T_body_tip.R.T @ T_body_tip.p
        self._axis = T_body_tip.R.T @ forest.tree.axis[body - 1]
        middle = np.array(draft.postures["ready"])
        own: list[Array] = []
        before: list[Array] = []
        for k in range(_TURNS):
            q = middle.copy()
            q[-1] = middle[-1] + 2.0 * np.pi * k / _TURNS * (not draft.drives[-1].prismatic)
            placed = study.capsules.place(q[None])
            frame = placed.frames[0, body - 1]
            ends = (placed.ends[0] - frame[:, 3]) @ frame[:, :3]
            ends = (ends - T_body_tip.p) @ T_body_tip.R  # (c, 2, 3) in the tip link
            own = [ends[study.capsules.body == body].reshape(-1, 3)]
            before += [ends[study.capsules.body == body - 1].reshape(-1, 3)]
        self._own, self._before = own[0], np.concatenate(before)
        self._radii = np.repeat(study.capsules.radius[study.capsules.body == body], 2)

    def directions(self) -> list[Array]:
        """Return the axes of the tip link (3,), those that look outward first."""
        way = self._outward()
        axes = [sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
        return sorted(axes, key=lambda axis: -float(axis @ way))

    def put(self, outward: Array) -> None:
        """Put the MRF in front of all that is fixed to the last joint, and a stalk to it."""
        most = float((self._own @ outward + self._radii).max(initial=0.0))
        self._draft.mrf = outward * round(max(most, 0.0) + STANDS_OUT + BALL, 4)
        inside = max(most - 0.02, 0.0)
        self._draft.tool = (outward * round(inside, 4), BALL)

    def _outward(self) -> Array:
        """Return a direction away from the arm.

        From the last joint to the tip; where they are one, along the joint's axis, away from the
        body that carries it; and where that lies beside the axis, to the last body's middle.
        """
        way = -self._joint
        if float(np.linalg.norm(way)) >= AT_THE_JOINT:
            return way
        if len(self._before):
            carrier = float((self._before.mean(axis=0) - self._joint) @ self._axis)
        else:
            carrier = 0.0
        aside = np.zeros(3)
        if len(self._own):
            middle = self._own.mean(axis=0) - self._joint
            aside = middle - (middle @ self._axis) * self._axis
        if float(np.linalg.norm(aside)) > max(AT_THE_JOINT, abs(carrier)):
            return aside
        return np.asarray(self._axis if carrier <= 0.0 else -self._axis)
