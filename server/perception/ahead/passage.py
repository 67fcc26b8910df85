"""Passage: what news of the contour ahead asks of base and arm, and for how long it is believed.

News of a sensor is no order: it slows down a base that is driven ahead, and names a posture that
the arm may take. Where it falls silent, no base drives ahead.
"""

import math
from typing import Final, NamedTuple, Self

import numpy as np

from ....config.load import Cell
from ....config.schema.sensors.scanner import ContourReflexSection
from ....protocols.messages.perception.contour import NOTHING, ContourNews
from ...control.spatial import Array
from ...refusals import Refused, Why
from ...runtime.events import Events
from .headway import HELD_BACK, NO_HEADWAY, STANDS, Headway

UNSEEN_BEHIND: Final = "unseen_behind"
"""Limit and event: the base goes back slowly, since nobody saw the ground there."""
FOLD_S: Final = 1.0
"""A posture is gone to for so long after the newest news; then the arm stands where it is [s]."""
REFUSALS: Final = {
    "base_blocked": "what carries the arm does not fit",
    "column_blocked": "the column between foot and shoulder does not fit",
    "no_posture": "no posture of the arm fits",
    "no_way": "there is a posture that fits, but no free way to it",
    "held_up": "the arm does not get to the posture that fits",
    HELD_BACK: "clearances hold the base where the reflex saw a way",
    NO_HEADWAY: "the base waits, and the reflex comes to no end",
    "sequence_f1": "no free place for the tool",
    "sequence_f2": "no free place for the elbow",
    "sequence_f3": "the tool cannot be brought behind the elbow",
    "sequence_stuck": "tool and elbow free each other's way in turn, and never both",
}
"""Reasons of a passage that is refused, in words."""


class PassageNews(NamedTuple):
    """The newest news."""

    tick: int
    phase: str
    reason: str
    posture: Array | None
    """All joints of the mechanism (n,) [rad]; NaN for those that it does not concern."""
    most_speed: float
    most_speed_back: float
    nearest: Array
    """The contour (rows, columns) [m]; NaN for nothing."""


class Passage:
    """Keeps the newest contour of one arm."""

    def __init__(
        self,
        contour: ContourReflexSection,
        silent_s: float,
        arm: list[int],
        cell: Cell,
        events: Events,
    ) -> None:
        """Build it for the joints `arm` of a mechanism."""
        self._contour, self._arm, self._events = contour, arm, events
        self._joints = cell.robot.joints
        self._silent_ticks = max(1, round(silent_s / cell.config.timing.period_s))
        self._fold_ticks = max(1, round(FOLD_S / cell.config.timing.period_s))
        self._headway = Headway(cell.config.timing.period_s)
        self._unseen = self._told_unseen = False
        self.newest: PassageNews | None = None
        self.silent = True
        """No news is fresh."""

    @classmethod
    def from_cell(cls, cell: Cell, events: Events) -> Self | None:
        """Return that of a cell; None where no contour is looked for."""
        config = cell.config
        if config.contour is None or config.scanner is None:
            return None
        beside = config.mechanism.beside_chain
        arm = [i for i, joint in enumerate(cell.robot.joints) if joint.name not in beside]
        return cls(config.contour, config.scanner.silent_s, arm, cell, events)

    def take(self, news: ContourNews, tick: int) -> None:
        """Take in a contour. Raises `Refused` where it does not fit."""
        if news.tick > tick:
            raise Refused(Why.FUTURE_PICTURE, f"tick {news.tick}, this is tick {tick}")
        before = self.newest
        if before is not None and news.tick < before.tick:
            raise Refused(Why.OUT_OF_ORDER, f"tick {news.tick} after {before.tick}")
        plane = self._contour.plane
        rows, columns = round(plane.height / plane.cell), round(plane.width / plane.cell)
        if (news.rows, news.columns) != (rows, columns) or news.cell != plane.cell:
            raise Refused(
                Why.OUT_OF_RANGE,
                f"{news.rows} by {news.columns} cells of {news.cell:g} m: the cell has {rows} by "
                f"{columns} of {plane.cell:g} m",
            )
        millimetres = np.frombuffer(news.nearest_mm, dtype="<u2").reshape(rows, columns)
        nearest = np.where(millimetres == NOTHING, np.nan, millimetres * 1e-3)
        self.newest = PassageNews(
            news.tick,
            news.phase,
            news.reason,
            self._posture(news.posture),
            math.inf if news.most_speed is None else news.most_speed,
            news.most_speed_back,
            nearest,
        )
        self._tell(before, self.newest)

    def _posture(self, told: tuple[float, ...] | None) -> Array | None:
        """Return a posture of all joints (n,). Raises `Refused` for one outside of the limits."""
        if told is None:
            return None
        if len(told) != len(self._arm):
            raise Refused(
                Why.WRONG_JOINTS, f"posture: {len(told)} joints: must be {len(self._arm)}"
            )
        posture = np.full(len(self._joints), np.nan)
        for i, angle in zip(self._arm, told, strict=True):
            joint = self._joints[i]
            if not joint.lower <= angle <= joint.upper:
                raise Refused(
                    Why.OUT_OF_RANGE,
                    f"posture: {joint.name}: {angle:g} is outside of {joint.lower:g} to "
                    f"{joint.upper:g}",
                )
            posture[i] = angle
        return posture

    def update(self, tick: int) -> None:
        """Update whether news is fresh, and report each change as an event."""
        newest = self.newest
        silent = newest is None or tick - newest.tick > self._silent_ticks
        if silent and not self.silent:
            age = 0 if newest is None else tick - newest.tick
            self._events.warning("scanner_silent", f"no contour for {age} ticks", age_ticks=age)
        elif self.silent and not silent:
            self._events.info("scanner_heard", "")
        self.silent = silent
        self._headway.lapse(tick)

    def posture(self, tick: int) -> Array | None:
        """Return the posture that the arm should take (n,) [rad]; None for none."""
        newest = self.newest
        if newest is None or tick - newest.tick > self._fold_ticks:
            return None
        return newest.posture

    def share(self, speed: float) -> float:
        """Return the share (0 to 1) of a drive's speed [m/s] that is let through.

        Ahead, where nothing is in the way; back, over ground that was seen, and slowly beyond.
        """
        if speed == 0.0 or not self._contour.wait:
            return 1.0
        if speed < 0.0:
            seen = 0.0 if self.silent or self.newest is None else self.newest.most_speed_back
            return min(1.0, max(seen, self._contour.creep) / -speed)
        if self.silent or self.newest is None:
            return 0.0
        return min(1.0, self.newest.most_speed / speed)

    @property
    def held(self) -> str:
        """Why a base makes no headway, or goes slowly back; empty where nothing holds it."""
        return UNSEEN_BEHIND if self._unseen else self._headway.reason

    def follow(self, speed: float, way: float, tick: int, *, cleared: bool) -> None:
        """Tell why a base that is driven ahead at a speed [m/s] makes no headway, if so.

        `way` [m] is how far its wheels have rolled; `cleared` whether clearances are limiting.
        What the reflex refuses, and silence, have names of their own.
        """
        self._look_behind(speed)
        before, newest = self._headway.reason, self.newest
        if newest is None or self.silent or newest.reason:
            self._headway.forget()
        else:
            goes = self.share(speed) * speed > STANDS
            self._headway.step(speed, way, tick, held=cleared and goes)
        reason = self._headway.reason
        if reason and not before:
            self._events.warning("passage_refused", REFUSALS[reason], reason=reason)
        elif before and not reason and newest is not None and newest.phase != "refused":
            self._events.info(f"passage_{newest.phase}", "")

    def _look_behind(self, speed: float) -> None:
        """Tell once that a base is driven back faster than the ground behind it is known."""
        if speed >= 0.0:
            self._told_unseen = False
        self._unseen = speed < 0.0 and self.share(speed) < 1.0
        if self._unseen and not self._told_unseen:
            self._told_unseen = True
            self._events.warning(
                "unseen_behind",
                f"{-speed:g} m/s back over ground that nobody saw: {self._contour.creep:g} at most",
                asked=-speed,
                most=self._contour.creep,
            )

    def blind(self, speed: float) -> bool:
        """Return whether a base that goes ahead at a speed [m/s] must stop: nobody looks ahead."""
        return self.silent and self._contour.wait and speed > STANDS

    def _tell(self, before: PassageNews | None, now: PassageNews) -> None:
        if before is not None and (before.phase, before.reason) == (now.phase, now.reason):
            return
        if now.phase == "refused":
            words = REFUSALS.get(now.reason, now.reason)
            self._events.warning("passage_refused", words, reason=now.reason)
        elif before is not None or now.phase != "clear":
            self._events.info(f"passage_{now.phase}", "")
