"""Sight lines: told when a link of the arm comes into one, and when it is free again.

A sight line may be soft, or avoidance switched off; of two lines one may have to be given up. What
sees along it then sees the arm, so operators are told which link hides what. A line begins at its
camera: of one that the wrist carries, the last links do not count.
"""

from typing import NamedTuple

import numpy as np

from ..control.mechanism.kinematics import Mechanism
from ..control.proximity.capsules import Capsules
from ..control.proximity.distance import measured
from ..control.scene import Scene
from ..control.spatial import Array, Pose
from ..runtime.events import Events

EVERY = 5
"""Periods between two looks [1]."""

FREE = 0.005
"""A line that was lost is free again from this distance on [m]."""


class Hidden(NamedTuple):
    """The link that is nearest to a sight line."""

    link: str
    gap: float
    """Distance of the capsule around it from the line's own radius [m]; below zero inside."""


class SightLines:
    """Watches the sight lines of one arm's surroundings."""

    def __init__(self, capsules: Capsules | None, mechanism: Mechanism, events: Events) -> None:
        """Build it for an arm's capsules; without any nothing is watched."""
        self._capsules, self._mechanism, self._events = capsules, mechanism, events
        self._lost: set[str] = set()

    @property
    def lost(self) -> tuple[str, ...]:
        """Names of the lines that a link is in."""
        return tuple(sorted(self._lost))

    def update(self, scene: Scene, q: Array, base: Pose | None) -> None:
        """Look at joint angles q (n,) [rad], and tell each change; `base` is where a Base is."""
        if self._capsules is None:
            return
        nearest = self._nearest(self._capsules, scene, q, base)
        self._lost &= nearest.keys()
        for name, (link, gap) in nearest.items():
            if gap < 0.0 and name not in self._lost:
                self._lost.add(name)
                self._events.warning(
                    "sight_line_lost",
                    f"{link} is {-1e3 * gap:.0f} mm into {name}",
                    obstacle=name,
                    link=link,
                    gap_m=gap,
                )
            elif gap > FREE and name in self._lost:
                self._lost.discard(name)
                self._events.info("sight_line_free", name, obstacle=name)

    def _nearest(
        self, capsules: Capsules, scene: Scene, q: Array, base: Pose | None
    ) -> dict[str, Hidden]:
        """Return the link that is nearest to each sight line, by the line's name."""
        rounds = scene.rounds
        lines = np.flatnonzero(rounds.line)
        if not len(lines):
            return {}
        scene = scene.placed(self._mechanism.pose_wrist(q, base))
        ends, body = capsules.place(q[None], base).ends, capsules.body
        every, found = np.flatnonzero(capsules.movable), {}
        for line in lines.tolist():
            which = every
            if rounds.carried[line]:
                which = every[body[every] < body.max()]
            if not len(which):
                continue
            pairs = which, np.full(len(which), len(body) + line)
            gaps = measured(ends, pairs, scene.segments)[0]
            gaps = gaps - capsules.radius[which] - rounds.radius[line]
            i = int(gaps.argmin())
            found[scene.names[line]] = Hidden(capsules.links[which[i]], float(gaps[i]))
        return found
