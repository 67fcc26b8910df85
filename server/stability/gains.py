"""Judgement of every loop that gains close: sources of an error, force control, following a hand.

The one place for it: gains that are asked for, a source that is switched on, a new MRF, a payload,
and `check`, which reads a cell. An MRF away from where the tool touches makes force control turn
the tool under every force there, and so give way by K_R r² more (`force_loop.py`).
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...config.load import Cell
from ...config.schema.sources.source import SourceSection
from ..control.mechanism.payload import Payload
from ..control.spatial import Array, Pose
from .following import stiffest_hand
from .force_loop import (
    BUS_PERIODS,
    DRIVE_PERIODS,
    ForceLoop,
    GainVector,
    bound,
    vision_periods,
)
from .payloads import PayloadBounds

WRENCH_SOURCES = ("following", "force")
"""The sources that move the tool for what the sensor reads."""


class Verdict(NamedTuple):
    """A loop against its bound."""

    share: float
    """Loop gain over its bound: unstable from 1 on [1]."""
    words: str

    @property
    def refusal(self) -> str | None:
        """Why it is refused; None for a stable one."""
        return self.words if self.share >= 1.0 else None


STABLE = Verdict(0.0, "")


class LoopBounds:
    """Bounds of the loops of one task; `grasps` are arms that hold its payload, each by its own."""

    def __init__(self, cell: Cell, grasps: Sequence[Cell] = ()) -> None:
        self._cell, self._held = cell, bool(grasps)
        self.payloads = PayloadBounds(cell)
        sensed = [c for c in grasps or (cell,) if c.config.mechanism.force_torque is not None]
        self._force = [ForceLoop(each) for each in sensed]

    @property
    def force_loop(self) -> ForceLoop | None:
        """The force loop of the first arm; None without a force/torque sensor."""
        return self._force[0] if self._force else None

    def gain(
        self,
        source: str,
        gains: GainVector,
        mrf: Pose | None = None,
        mass: float | None = None,
    ) -> Verdict:
        """Judge a source's gains (6,) with an MRF in the Wrist and a payload [kg], else the cell's.

        What several arms hold gives way at each grasp, whatever the MRF of their task is.
        """
        config = self._cell.config
        section = config.sources.each[source]
        if section.NEEDS == "force_torque" and not self._force:
            return Verdict(np.inf, "the cell has no force/torque sensor")
        at = None if self._held else mrf
        if source == "following":
            return self._following(gains, at, mass)
        if source == "force":
            return max((_force(loop, gains, at) for loop in self._force), key=_share)
        if section.ERROR_GAIN is None:
            return STABLE
        limit, period = bound(error_delay_periods(self._cell, section)), config.timing.period_s
        return max((_axis(i, g, g * period, limit) for i, g in enumerate(gains)), key=_share)

    def payload(self, payload: Payload, gains: Mapping[str, Array], mrf: Pose) -> str | None:
        """Return why a payload would swing the tool at gains (6,) by source, or None.

        Its inertia acts at its centre of mass: force control turns the tool under that as well.
        """
        following, force = (gains[name] for name in WRENCH_SOURCES)
        gives = float(force[:3].max())
        if not self._held and self._force and gives > 0.0:
            gives = self._force[0].gives(force, payload.com, mrf)
        return self.payloads.refusal(payload.mass, float(following[:3].max()), gives)

    def _following(self, shares: GainVector, mrf: Pose | None, mass: float | None) -> Verdict:
        for i, share in enumerate(shares):
            if not 0.0 <= share <= 1.0:
                words = f"gain[{i}] = {share:g}: a share of what is measured, between 0 and 1"
                return Verdict(np.inf, words)
        hand, lever = self._cell.config.sources.following.stiffest_hand, 0.0
        if not self._held:
            lever = self._force[0].lever(mrf)
        along, about = max(shares[:3]), max(shares[3:])
        most = stiffest_hand(self._cell, along, mass, lever**2 * about)
        words = f"gain[{int(np.argmax(shares[:3]))}] = {along:g}: a hand of {hand:g} N/m, "
        if lever**2 * about > 0.0:
            words += f"{lever:.3g} m from the MRF at {about:g} of its moment, "
        return Verdict(hand / most, f"{words}stable below {most:.3g}")


def _force(loop: ForceLoop, gains: GainVector, mrf: Pose | None) -> Verdict:
    """Judge force control along each axis of the MRF, and where else the tool may touch."""
    period_s, found = loop.period_s, [STABLE]
    for i, axis in enumerate(loop.axes(gains, mrf)):
        if axis is not None:
            found.append(_axis(i, gains[i], gains[i] * axis.stiffness * period_s, axis.bound))
    worst = max(found, key=_share)
    contact = loop.touching(gains, mrf)
    if contact.share <= worst.share:
        return worst
    if worst.share >= 1.0:
        return Verdict(contact.share, worst.words)
    words = (
        f"a contact {contact.lever:.3g} m from the MRF turns the tool: loop gain "
        f"{contact.loop_gain:.3g}, stable below {contact.bound:.3g}"
    )
    if contact.share >= 1.0 and mrf is not None:
        reach = loop.reach(gains, mrf)
        words += f"; at these gains the MRF may be {reach:.3g} m from the tool's tip"
    return Verdict(contact.share, words)


def _axis(i: int, gain: float, loop: float, limit: float) -> Verdict:
    words = f"gain[{i}] = {gain:g}: loop gain {loop:.3g}, stable below {limit:.3g}"
    return Verdict(loop / limit, words)


def _share(verdict: Verdict) -> float:
    return verdict.share


def error_delay_periods(cell: Cell, section: SourceSection) -> float:
    """Return the delay of the loop that a gain of the pose's error closes [periods]."""
    return vision_periods(cell) if section.NEEDS == "camera" else BUS_PERIODS + DRIVE_PERIODS
