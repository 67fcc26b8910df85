"""Judgement of what is asked for or declared: gains, payloads and inertias that loops bear."""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...config.consistency import REQUIRED_POSTURES
from ...config.load import Cell
from ...config.schema.sources import SourceSection
from ..control.inputs import Payload
from ..control.mechanism.model import Dynamics, Mechanism
from ..control.parameters import Parameters
from ..control.spatial import Array, Pose
from .loops import (
    BUS_PERIODS,
    DRIVE_PERIODS,
    HEAVIEST,
    ForceLoop,
    GainVector,
    bound,
    following_source,
    force_source,
    heaviest,
    lightest_ratio,
    stiffest_hand,
    vision_periods,
)

# --- Bound of the inertia that a payload may add to the torque law's model, were it not there -----
#
# The law moves joints as its model says. Where a payload is told that does not hang there, the
# arm has a part of that inertia only, and answers every torque more than the law expects: below
# some part the loop swings by itself (`loops.py`). A light payload far out does as much
# as a heavy one.


class ToldInertia:
    """Inertia of one cell's arm with a payload and without, judged for drives in CST."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell

    @cached_property
    def least(self) -> float:
        """Least part of the modelled inertia with which the law stands [1]."""
        return lightest_ratio(self._cell.config.torque, self._cell.config.timing.period_s)

    @cached_property
    def _dynamics(self) -> Dynamics:
        p = Parameters.from_cell(self._cell)
        return Dynamics(Mechanism.from_cell(self._cell), p.rotor_inertia, p.T_wrist_sensor)

    def part(self, payload: Payload) -> float:
        """Return the part of the modelled inertia that is there without a payload [1].

        Of the joint motion that the payload weighs upon most, at the postures that every cell has.
        """
        postures, dynamics, least = self._cell.config.mechanism.postures, self._dynamics, 1.0
        for name in REQUIRED_POSTURES:
            q = np.array(postures[name])
            dynamics.carry(payload.mass, payload.com)
            told = dynamics.terms(q, np.zeros(len(q))).M
            dynamics.carry(0.0, np.zeros(3))
            bare = dynamics.terms(q, np.zeros(len(q))).M
            least = min(least, float(np.linalg.eigvals(np.linalg.solve(told, bare)).real.min()))
        return least

    def refusal(self, payload: Payload) -> str | None:
        """Return why the law would swing if a payload were told and not there, or None."""
        if self._cell.config.mechanism.operation_mode != "cst":
            return None
        part = self.part(payload)
        if part >= self.least:
            return None
        lever = float(np.linalg.norm(payload.com))
        return (
            f"{payload.mass:g} kg with its centre {lever:.3g} m from the sensor: without it the "
            f"arm has {part:.2g} of the inertia that the torque law would move, and swings below "
            f"{self.least:.2g}; the sensor does not read that it is there"
        )


# --- Bounds of payloads under which force control and following a hand are stable -----------------
#
# The bounds take a while to find, so they are found once: `prepare` does so before the first
# tick.

REFERENCE_GAIN = 0.01
"""K_F at which the force loop's heaviest payload is looked for [m/s/N]."""


class PayloadBounds:
    """Heaviest payloads for the sources of one cell; without a sensor there are no bounds."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self.inertia = ToldInertia(cell)

    def prepare(self) -> None:
        """Find the bounds of what may be switched on."""
        if self._cell.config.mechanism.force_torque is not None:
            _ = self.following, self.force

    @cached_property
    def following(self) -> float:
        """Heaviest payload with which following a hand stands by itself [kg]; inf: any."""
        return heaviest(self._cell, lambda m: following_source(self._cell, m))

    @cached_property
    def force(self) -> float:
        """Greatest K_F times payload with which force control stands by itself [s]; inf: any."""
        source = force_source(self._cell, REFERENCE_GAIN)
        return REFERENCE_GAIN * heaviest(self._cell, lambda _: source, averaged=False)

    def refusal(self, mass: float, following: float, force: float) -> str | None:
        """Return why a payload [kg] would swing the tool, or None.

        `following` is the share of the hand's force that is followed, `force` the greatest K_F
        [m/s/N]; 0 where a source is off.
        """
        if following > 0.0:
            if mass >= self.following:
                return (
                    f"a payload of {mass:g} kg swings a tool that follows a hand as "
                    f"{self._cell.config.sources.following.mass:g} kg by itself; stable below "
                    f"{self.following:.3g} kg"
                )
            hand = self._cell.config.sources.following.stiffest_hand
            most = stiffest_hand(self._cell, following, mass)
            if hand >= most:
                return (
                    f"under a payload of {mass:g} kg, a hand of {hand:g} N/m makes the tool swing; "
                    f"stable below {most:.3g} N/m"
                )
        if force * mass >= self.force:
            return (
                f"a payload of {mass:g} kg swings the tool at a force gain of {force:g}; stable "
                f"below {self.force / force:.3g} kg"
            )
        return None


def payload_words(mass: float) -> str:
    """Return a heaviest payload [kg] in words."""
    return f"to {HEAVIEST:g} kg and more" if math.isinf(mass) else f"below {mass:.3g} kg"


# --- Judgement of every loop that gains close: sources of an error, force control, following a hand
#
# The one place for it: gains that are asked for, a source that is switched on, a new MRF, a
# payload, and `check`, which reads a cell. An MRF away from where the tool touches makes force
# control turn the tool under every force there, and so give way by K_R r² more
# (`loops.py`).

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
