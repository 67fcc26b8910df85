"""What is ahead of a base that drives: the contour's passage, its headway, and where it is."""

import math
from collections import deque
from typing import Final, NamedTuple, Self

import numpy as np

from ...config.load import Cell
from ...config.schema.mechanism import DifferentialBaseSection
from ...config.schema.surroundings import ContourReflexSection
from ...protocols.messages.perception import NOTHING, ContourNews
from ..control.scene import Body
from ..control.spatial import Array, Motion, Pose, rotation_exp, sizes
from ..control.wheels import DifferentialDrive, Odometry
from ..events import Events
from ..refusals import Refused, Why

# --- Headway of a base that is driven ahead: whether it comes on, and a name for what holds it ----
#
# The reflex tells why there is no way through. What it takes for one, and is none, is told
# here: no base stands for ever without a reason.

STANDS: Final = 1e-3
"""A base that is slower stands [m/s]."""
HEADWAY_M: Final = 0.02
"""A base that has come so much farther ahead makes headway [m]."""
LEAST_SHARE: Final = 0.5
"""One that is driven slowly is asked for this share of its way in `HELD_S` [1]."""
HELD_S: Final = 4.0
"""Clearances hold a base when they slowed it for so long without headway [s]."""
WAITING_S: Final = 30.0
"""Deciding and folding take less [s]: what waits longer will wait for ever."""
HELD_BACK, NO_HEADWAY = "held_back", "no_headway"
REASONS: Final = (HELD_BACK, NO_HEADWAY)


class Headway:
    """Follows how far a base came while it was asked to go ahead."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self.forget()

    def forget(self) -> None:
        """Know nothing: the base is not driven ahead, or why it stands is told already."""
        self.reason = ""
        """Why the base makes no headway; empty while it does, or while that is not known yet."""
        self._mark_m: float | None = None
        self._since = self._newest = self._held = 0

    def lapse(self, tick: int) -> None:
        """Know nothing any more where nobody was driven in the tick before."""
        if tick > self._newest + 1:
            self.forget()

    def step(self, asked: float, way: float, tick: int, *, held: bool) -> None:
        """Take in one tick of a base that is asked for a speed ahead [m/s].

        `way` [m] is how far its wheels have rolled, from anywhere; `held` whether clearances are
        what slows it.
        """
        self.lapse(tick)
        if asked <= STANDS:
            self.forget()
        self._newest = tick
        if asked <= STANDS:
            return
        least = min(HEADWAY_M, LEAST_SHARE * asked * HELD_S)
        if self._mark_m is None or way - self._mark_m >= least:
            self.reason, self._mark_m, self._since, self._held = "", way, tick, 0
            return
        self._held += held
        if self.reason:
            return
        if self._held * self._period_s >= HELD_S:
            self.reason = HELD_BACK
        elif (tick - self._since) * self._period_s >= WAITING_S:
            self.reason = NO_HEADWAY


# --- Passage: what news of the contour ahead asks of base and arm, and for how long it is believed
#
# News of a sensor is no order: it slows down a base that is driven ahead, and names a posture
# that the arm may take. Where it falls silent, no base drives ahead.

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


# --- Base tracker: odometry of a base on wheels, corrected by news of where it is -----------------
#
# News names the telemetry tick in which it was measured, and is held against where the odometry
# had the base then. What they differ by is made up for slowly; more than wheels drift by is a
# slip, and then nobody knows where the tool is in World until both agree again.
#
# A gyroscope sees at once how Base turns (gyrodometry: Borenstein and Feng 1996). Wheels know it
# better in the long run, so they are believed while both agree; while they do not, wheels slip,
# and the turn is the gyroscope's. What it reads while the wheels stand is its bias (a zero-rate
# update); it drifts slowly, and is followed while a base goes straight, too. A bias that jumps
# looks like slip until the wheels stand: nothing turns a base evenly on wheels that stand. Then it
# is the bias, and what it had turned Base by is taken back, slowly. So is what a unit said in the
# time in which it fell silent or stuck, before its driver knew.

REMEMBERED_S: Final = 2.0
"""News that is older is of no use [s]."""
HEADING_GAIN: Final = 0.3
"""Part of a heading's difference that one piece of news corrects [1]."""
SLIPS_S: Final = 1.0
"""Of what wheels turned too much or too little the newest is counted, for about so long [s]."""
STAND_S: Final = 0.3
"""Wheels that have not turned for so long stand: over it the first bias is a mean [s]."""
MOST_BIAS: Final = 0.1
"""A gyroscope that reads more beside wheels that stand is turned, not biased [rad/s]."""
STILL: Final = 1e-3
"""Wheels that turn Base more slowly stand [rad/s]."""
BIAS_S: Final = 0.5
"""Time constant of the gyroscope's bias, while wheels stand [s]."""
STRAIGHT: Final = 0.02
"""Wheels that turn Base more slowly go straight [rad/s]."""
STRAIGHT_S: Final = 10.0
"""Time constant of the bias while a base goes straight: of its drift with the temperature [s]."""
EVEN_S: Final = 1.0
"""Beside wheels that stand, a rate that is even over so long is a bias that jumped [s]."""
EVEN: Final = 0.3
"""Even is a rate whose halves differ by less than this part of `slip_rate` [1]."""
AGREES: Final = 0.5
"""Wheels grip again when odometry and news differ by less than this part of a slip [1]."""


class BaseTracker:
    """Tracks one base that rolls."""

    def __init__(
        self,
        section: DifferentialBaseSection,
        rolling: DifferentialDrive,
        T_world_base: Pose,
        period_s: float,
        events: Events,
        up_imu: Array | None = None,
    ) -> None:
        """Build it; `up_imu` (3,) is Base's z in the axes of a gyroscope on it, None without."""
        self._section, self._rolling, self._period_s = section, rolling, period_s
        self._up_imu = up_imu
        self._rate: float | None = None
        """How Base turns about its z by the gyroscope, bias included [rad/s]; None without."""
        self._rate_before: float | None = None
        self._bias: float | None = None
        """What it reads while Base stands [rad/s]; None before that was seen."""
        self._stood_s = self._first_bias = 0.0
        self._beside = deque[float](maxlen=round(EVEN_S / period_s))
        """What it read more than its bias while the wheels stood, the newest last [rad/s]."""
        self._turned_s = 0.0
        """For how long it turned Base since it last agreed with wheels that stood [s]."""
        self._repeated = 0.0
        """By what it turned Base while its samples were equal: it may have stuck [rad]."""
        self._back = 0.0
        """What it had turned Base by wrongly, and is taken back [rad]."""
        self._slid = 0.0
        """Turn of the last second that the wheels missed [rad]."""
        self._events = events
        self._begun = False
        self.odometry = Odometry.at(T_world_base, np.zeros(2))
        self.twist = np.zeros(6)
        """At which the commanded base is being corrected, at its origin in World axes."""
        self.slips = False
        """Odometry and news disagree: where the tool is in World is not known."""
        self.slipping = False
        """A scanner sees wheels slip now: a drive stops."""
        self._told: int | None = None
        """Tick of the newest news of that."""
        self._past = deque[tuple[int, Pose]](maxlen=round(REMEMBERED_S / period_s))
        self._newest = -1

    @classmethod
    def from_cell(cls, cell: Cell, events: Events) -> Self | None:
        """Return the tracker of a loaded cell; None where nothing rolls."""
        c, rolling = cell.config, DifferentialDrive.from_cell(cell)
        if c.mechanism.base is None or rolling is None:
            return None
        place = c.mechanism.T_world_base
        T = Pose.from_xyz_rpy(place.xyz, place.rpy)
        imu, up = c.mechanism.imu, None
        if imu is not None and imu.on == "base":
            up = Pose.from_xyz_rpy(imu.T_on_imu.xyz, imu.T_on_imu.rpy).R[2]
        return cls(c.mechanism.base, rolling, T, c.timing.period_s, events, up)

    def step(self, tick: int, told: Motion | None, q: Array) -> Body:
        """Return the base for the command of `tick`; joints are measured at q (n,) [rad]."""
        wheels, commanded = q[:2], None if told is None else told.q[:2]
        way = wheels - self.odometry.measured.wheels if self._begun else np.zeros(2)
        if commanded is None or not self._begun:
            self.odometry = self.odometry.forget(wheels, wheels)
            self._begun = True
        off = self._missed_turn(way)
        if commanded is None:
            off = self._turned_s = self._repeated = self._back = 0.0
        self.odometry = self.odometry.rolled(self._rolling, commanded, wheels)
        most = self._section.correction
        if self._back != 0.0:
            self.odometry = self.odometry.slid(self.odometry.measured, 0.0, 0.0, self._back)
            self._slid, self._back = 0.0, 0.0
        if off != 0.0:
            # It is turned by that, not told late of it: so it is as quickly right again.
            self.odometry = self.odometry.slid(self.odometry.measured, 0.0, 0.0, off)
            most = most[0], most[1] + abs(off) / self._period_s
        self.odometry, self.twist = self.odometry.corrected(most, self._period_s)
        self._past.append((tick, self.odometry.measured))
        if self._told is not None and (tick - self._told) * self._period_s > REMEMBERED_S:
            self.slipping = False
        if off != 0.0 or (self.slips and (self._told is not None or self._up_imu is not None)):
            self._judge(*sizes(self.odometry.drift))
        return self.odometry.body(self.twist)

    def take_rate(self, rate: Array | None) -> None:
        """Take in how Base turns (3,) by the gyroscope on it, in its axes [rad/s]; None: stale."""
        self._rate_before, self._rate = self._rate, None
        if rate is not None and self._up_imu is not None:
            self._rate = float(self._up_imu @ rate)

    def _missed_turn(self, way: Array) -> float:
        """Return by how much more Base turned than wheels did on a `way` (2,) [rad]; 0 for agreed.

        While the wheels stand, the gyroscope's bias is learnt; while they go straight, followed.
        """
        self._slid *= 1.0 - self._period_s / SLIPS_S
        if self._rate is None or self._rate_before is None:
            self._stood_s = 0.0
            self._beside.clear()
            self._back, self._repeated = -self._repeated, 0.0
            return 0.0
        if self._rate != self._rate_before:
            self._repeated = 0.0
        wheels = self._rolling.turn * float(way[1] - way[0]) / self._period_s
        off = 0.5 * (self._rate_before + self._rate) - wheels
        stand = self._rolling.turn * float(np.abs(way).max()) < STILL * self._period_s
        self._stood_s = self._stood_s + self._period_s if stand else 0.0
        if self._bias is None:
            self._learn_first(off)
            return 0.0
        off -= self._bias
        if not stand:
            self._beside.clear()
        elif self._jumped(off):
            return 0.0
        if abs(off) > self._section.slip_rate:
            self._slid += off * self._period_s
            self._turned_s += self._period_s
            self._repeated += off * self._period_s
            return off * self._period_s
        if self._stood_s > STAND_S:
            self._bias += off * self._period_s / BIAS_S
            self._turned_s = 0.0
        elif abs(wheels) < STRAIGHT:
            self._bias += off * self._period_s / STRAIGHT_S
        return 0.0

    def _jumped(self, off: float) -> bool:
        """Take in what the gyroscope reads more than its bias beside wheels that stand [rad/s].

        Return whether the bias jumped: then it is the new one, or none where that is too great, and
        what it had turned Base by is to be taken back.
        """
        self._beside.append(off)
        if len(self._beside) < (self._beside.maxlen or 0):
            return False
        told, most = np.array(self._beside), self._section.slip_rate
        mean, half = float(told.mean()), len(told) // 2
        even = abs(float(told[:half].mean() - told[half:].mean())) < EVEN * most
        if abs(mean) <= most or not even or float(np.abs(told - mean).max()) > most:
            return False
        self._back = -mean * self._turned_s
        bias = mean if self._bias is None else self._bias + mean
        believed = abs(bias) <= MOST_BIAS
        self._bias = bias if believed else None
        self._stood_s = self._first_bias = self._turned_s = self._repeated = 0.0
        self._beside.clear()
        self._events.warning(
            "gyroscope_biased",
            f"it reads {bias:+.3f} rad/s beside wheels that stand: "
            + ("its new bias" if believed else f"at most {MOST_BIAS:g}, so wheels are believed"),
            bias_rad_s=bias,
            taken_back_rad=-self._back,
        )
        return True

    def _learn_first(self, off: float) -> None:
        """Take the mean over wheels that stand for the bias; until then they are believed."""
        if self._stood_s == 0.0 or abs(off) > MOST_BIAS:
            self._stood_s = self._first_bias = 0.0
            return
        self._first_bias += off * self._period_s
        if self._stood_s > STAND_S:
            self._bias = self._first_bias / self._stood_s

    def take_pose(self, tick: int, T_world_base: Pose) -> None:
        """Take in where Base was at a tick."""
        T_then = self._at(tick)
        if T_then is not None:
            self._see(T_then, T_world_base)

    def take_heading(self, tick: int, yaw: float) -> None:
        """Take in which way Base pointed at a tick, in World [rad]."""
        T_then = self._at(tick)
        if T_then is None:
            return
        x, y = T_then.R[0, 0], T_then.R[1, 0]
        off = math.remainder(yaw - math.atan2(y, x), 2.0 * math.pi)
        turn = rotation_exp(np.array([0.0, 0.0, HEADING_GAIN * off]))
        self._see(T_then, Pose(turn @ T_then.R, T_then.p), heading=off)

    def take_slide(
        self, tick: int, slipping: bool, slide: tuple[float, float, float] | None
    ) -> None:
        """Take in whether a scanner sees wheels slip, and how Base slid by then: x, y, yaw."""
        self.slipping, self._told = slipping, tick
        T_then = next((T for then, T in self._past if then == tick), None)
        if slide is None or T_then is None:
            return
        self.odometry = self.odometry.slid(T_then, *slide)
        self._judge(*sizes(self.odometry.drift))

    def _at(self, tick: int) -> Pose | None:
        """Return where the odometry had Base at a tick; None for news that is not newer."""
        if tick <= self._newest:
            return None
        found = next((T for then, T in self._past if then == tick), None)
        if found is not None:
            self._newest = tick
        return found

    def _see(self, T_then: Pose, T_world_base: Pose, heading: float | None = None) -> None:
        self.odometry = self.odometry.seen(T_then, T_world_base)
        off, turned = sizes(self.odometry.drift)
        self._judge(off, turned if heading is None else abs(heading))

    def _judge(self, off: float, turned: float) -> None:
        """Tell whether wheels slip: odometry and news differ by [m] and [rad]."""
        far, wide = self._section.slip
        turned = max(turned, abs(self._slid))
        worst = max(off / far, turned / wide)
        if not self.slips and (worst > 1.0 or self.slipping):
            self.slips = True
            self._events.warning(
                "wheels_slip",
                f"wheels and what else tells of Base differ by {off:.3f} m and {turned:.3f} rad, "
                f"at most {far:g} m and {wide:g} rad: the tool is not held in World until they "
                "agree",
                distance_m=off,
                angle_rad=turned,
            )
        elif self.slips and worst < AGREES and not self.slipping:
            self.slips = False
            self._events.info("wheels_grip", "wheels and what else tells of Base agree again")
