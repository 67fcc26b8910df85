"""What is near the arm: links against obstacles and against each other, far pairs culled cheaply.

A pair is a capsule of the arm (`first`) and another thing (`second`): a capsule of the arm, a round
or a box of the scene. Three kinds in this order, one array entry each: own, round, box.
"""

from typing import NamedTuple

import numpy as np

from ....config.load import Cell
from ..frames import Array
from ..scene import Scene
from .distance import Near, cross, dot, segments, segments_boxes
from .links import Flags, Index, Links, Placed

NEIGHBOURS = 2
"""Links that so many joints part, or fewer, may overlap by design [1]."""


class Pairs(NamedTuple):
    """Pairs by index: capsules of the arm, obstacles of the scene as it counts them."""

    own: Index
    """(p, 2) capsules."""
    rounds: Index
    """(r, 2) capsule and round."""
    boxes: Index
    """(b, 2) capsule and box, counted from the first box."""

    def chosen(self, flags: Flags) -> "Pairs":
        """Return those that are flagged, of all in their order."""
        p, r = len(self.own), len(self.rounds)
        return Pairs(self.own[flags[:p]], self.rounds[flags[p : p + r]], self.boxes[flags[p + r :]])

    @property
    def first(self) -> Index:
        """The capsules that come first, of all pairs in their order."""
        return np.concatenate([self.own[:, 0], self.rounds[:, 0], self.boxes[:, 0]])


class Neighbours(NamedTuple):
    """The pairs that are near at one posture, and how; all arrays have one row per pair."""

    pairs: Pairs
    placed: Placed
    near: Near
    gap: Array
    """Distance of the surfaces [m]."""
    promise: Array
    """Distance that is promised [m]."""
    rows: Array
    """Slope of the gap in the joint angles (k, n) [m/rad]."""
    speed: Array
    """Speed at which the second may come nearer [m/s]."""
    obstacle: Index
    """Index of the second in the scene; −1 for links."""
    carried: Array
    """Speed at which a moving Base carries the first (k,) [m/s]."""

    @property
    def size(self) -> int:
        """Number of pairs."""
        return len(self.gap)


class Around:
    """Finds what is near the arm of one cell."""

    def __init__(self, cell: Cell, links: Links) -> None:
        self.links = links
        avoidance = cell.config.avoidance
        self._own_clearance = avoidance.self_clearance
        self._contacts = {(c.link, c.other) for c in avoidance.allowed_contacts}
        self._own = self._own_pairs(avoidance.self_clearance + avoidance.margin)
        self._radius_own = links.radius[self._own].sum(axis=1)
        self._size_own = (links.half_length + links.radius)[self._own].sum(axis=1)
        self._of: tuple[tuple[str, ...], Flags] | None = None

    def look(self, placed: Placed, scene: Scene | None, room: Array, ahead_s: float) -> Neighbours:
        """Return the pairs at one posture that are nearer than promised plus `room` (c,) [m].

        `room` is how far each capsule may come; `ahead_s` the time for which what moves counts.
        """
        ends = placed.ends[0]
        centre = 0.5 * (ends[:, 0] + ends[:, 1])
        between = centre[self._own[:, 0]] - centre[self._own[:, 1]]
        reach = self._size_own + self._own_clearance + room[self._own].sum(axis=1)
        own = self._own[dot(between, between) < reach * reach]
        rounds = boxes = np.zeros((0, 2), dtype=np.int64)
        if scene is not None:
            wanted = self._wanted(scene)
            further = scene.clearance
            if scene.moves:
                speed = np.sqrt(dot(scene.velocity, scene.velocity))
                further = further + scene.reach(ahead_s) + speed * ahead_s
            rounds = self._near_rounds(centre, scene, wanted, room, further)
            boxes = self._near_boxes(centre, scene, wanted, room, further)
        return self._measured(Pairs(own, rounds, boxes), placed, scene)

    def _measured(self, pairs: Pairs, placed: Placed, scene: Scene | None) -> Neighbours:
        near = self.between(placed.ends[0], pairs, scene)
        gap = near.distance - self.radii(pairs, scene)
        p = len(pairs.own)
        promise = np.full(len(gap), self._own_clearance)
        speed = np.zeros(len(gap))
        obstacle = np.full(len(gap), -1, dtype=np.int64)
        if scene is not None and p < len(gap):
            index = obstacle[p:] = np.concatenate(
                [pairs.rounds[:, 1], pairs.boxes[:, 1] + len(scene.rounds.radius)]
            )
            promise[p:] = scene.clearance[index]
            if scene.moves:
                closing = dot(near.normal[p:], scene.velocity[index])
                speed[p:] = np.maximum(scene.speed[index] + closing, 0.0)
        rows = self._slopes(pairs, placed, near)
        none = np.zeros(len(gap))
        return Neighbours(pairs, placed, near, gap, promise, rows, speed, obstacle, none)

    def between(self, ends: Array, pairs: Pairs, scene: Scene | None) -> Near:
        """Return where pairs are nearest, segments taken without their radii.

        `ends` (..., c, 2, 3) are the capsules' in World; the scene stands still.
        """
        parts = []
        p, r = len(pairs.own), 0 if scene is None else len(pairs.rounds)
        if p + r:
            # Both kinds in one pass: most of its cost is the number of operations.
            first = ends[..., np.concatenate([pairs.own[:, 0], pairs.rounds[:, 0]]), :, :]
            second = np.empty_like(first)
            second[..., :p, :, :] = ends[..., pairs.own[:, 1], :, :]
            if scene is not None:
                i = pairs.rounds[:, 1]
                second[..., p:, 0, :], second[..., p:, 1, :] = (
                    scene.rounds.start[i],
                    scene.rounds.end[i],
                )
            parts.append(
                segments(first[..., 0, :], first[..., 1, :], second[..., 0, :], second[..., 1, :])
            )
        if scene is not None and len(pairs.boxes):
            link, i = ends[..., pairs.boxes[:, 0], :, :], pairs.boxes[:, 1]
            R, centre, half = scene.boxes.R[i], scene.boxes.centre[i], scene.boxes.half[i]
            parts.append(segments_boxes(link[..., 0, :], link[..., 1, :], R, centre, half))
        if len(parts) == 1:
            return parts[0]
        if not parts:
            none = np.zeros((*ends.shape[:-3], 0))
            return Near(none, np.zeros((*none.shape, 3)), np.zeros((*none.shape, 3)), none)
        return Near(
            np.concatenate([part.distance for part in parts], axis=-1),
            np.concatenate([part.normal for part in parts], axis=-2),
            np.concatenate([part.place for part in parts], axis=-2),
            np.concatenate([part.part for part in parts], axis=-1),
        )

    def radii(self, pairs: Pairs, scene: Scene | None) -> Array:
        """Return what the surfaces of pairs are nearer than their segments (k,) [m]."""
        r = self.links.radius
        own = r[pairs.own[:, 0]] + r[pairs.own[:, 1]]
        if scene is None:
            return np.asarray(own)
        rounds = r[pairs.rounds[:, 0]] + scene.rounds.radius[pairs.rounds[:, 1]]
        return np.concatenate([own, rounds, r[pairs.boxes[:, 0]]])

    def _slopes(self, pairs: Pairs, placed: Placed, near: Near) -> Array:
        """Return the slopes (k, n) of the distances: the normal times the place's Jacobian.

        n·(z × (x − o)) = z·(x × n) − n·(z × o); a second link's place lies on the same normal,
        so that only the joints between the two links count.
        """
        frames = placed.frames[0]
        z, o = self.links.chain.axes(frames), frames[:, :, 3]
        moved = self.links.moved[pairs.first]
        if len(pairs.own):
            moved[: len(pairs.own)] -= self.links.moved[pairs.own[:, 1]]
        rows = cross(near.place, near.normal) @ z.T - near.normal @ cross(z, o).T
        prismatic = self.links.chain.prismatic
        if prismatic.any():
            rows[:, prismatic] = near.normal @ z[prismatic].T
        return np.asarray(rows * moved)

    # --- culling -----------------------------------------------------------------------------

    def _wanted(self, scene: Scene) -> Flags:
        """Return which capsules and obstacles (c, k) are kept apart at all."""
        if self._of is not None and self._of[0] == scene.names:
            allowed = self._of[1]
        else:
            allowed = np.array(
                [
                    [body > 0 and (link, name) not in self._contacts for name in scene.names]
                    for link, body in zip(self.links.links, self.links.body, strict=True)
                ],
                dtype=bool,
            ).reshape(len(self.links.links), -1)
            self._of = (scene.names, allowed)
        return np.asarray(allowed & scene.hard)

    def _near_rounds(
        self, centre: Array, scene: Scene, wanted: Flags, room: Array, further: Array
    ) -> Index:
        rounds = scene.rounds
        m = len(rounds.radius)
        if not m:
            return np.zeros((0, 2), dtype=np.int64)
        middle, way = 0.5 * (rounds.start + rounds.end), rounds.end - rounds.start
        size = 0.5 * np.sqrt(dot(way, way)) + rounds.radius + further[:m]
        reach = (room + self.links.half_length + self.links.radius)[:, None] + size
        between = centre[:, None, :] - middle
        return np.argwhere((dot(between, between) < reach * reach) & wanted[:, :m])

    def _near_boxes(
        self, centre: Array, scene: Scene, wanted: Flags, room: Array, further: Array
    ) -> Index:
        boxes, m = scene.boxes, len(scene.rounds.radius)
        if not len(boxes.half):
            return np.zeros((0, 2), dtype=np.int64)
        local = np.einsum("bji,cbj->cbi", boxes.R, centre[:, None, :] - boxes.centre)
        out = np.maximum(np.abs(local) - boxes.half, 0.0)
        reach = (room + self.links.half_length + self.links.radius)[:, None] + further[m:]
        return np.argwhere((dot(out, out) < reach * reach) & wanted[:, m:])

    def _own_pairs(self, least: float) -> Index:
        """Return the pairs of links to keep apart: no neighbours, none that meet at neutral."""
        links = self.links
        found = [
            (i, j)
            for j in range(len(links.capsules))
            for i in range(j)
            if links.body[j] - links.body[i] > NEIGHBOURS
            and not {(links.links[i], links.links[j]), (links.links[j], links.links[i])}
            & self._contacts
        ]
        pairs = np.array(found, dtype=np.int64).reshape(-1, 2)
        ends = links.place(np.zeros((1, links.chain.n))).ends[0]
        a, b = ends[pairs[:, 0]], ends[pairs[:, 1]]
        apart = segments(a[:, 0], a[:, 1], b[:, 0], b[:, 1]).distance
        return np.asarray(pairs[apart - links.radius[pairs].sum(axis=1) > least])
