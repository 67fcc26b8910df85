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
from ..control.spatial import GRAVITY, Array, Motion, Pose, rotation_exp, sizes
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
PAST_S: Final = 3.0
"""A base that steered aside is past what it met when it has gone straight ahead for so long [s]."""
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
    curvature: float
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
        self._past_ticks = self._straight = round(PAST_S / cell.config.timing.period_s)
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
        if abs(news.curvature) > self._contour.steer:
            most = self._contour.steer
            raise Refused(Why.OUT_OF_RANGE, f"curvature: {news.curvature:g}: at most {most:g}")
        millimetres = np.frombuffer(news.nearest_mm, dtype="<u2").reshape(rows, columns)
        nearest = np.where(millimetres == NOTHING, np.nan, millimetres * 1e-3)
        self.newest = PassageNews(
            news.tick,
            news.phase,
            news.reason,
            self._posture(news.posture),
            math.inf if news.most_speed is None else news.most_speed,
            news.most_speed_back,
            news.curvature,
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

    def turn(self, speed: float, turn: float) -> float:
        """Return the turn of a base [rad/s] that an operator drives at a speed [m/s], and turns.

        One that is driven straight ahead steers aside; who turns it himself is obeyed.
        """
        steers = speed > 0.0 and turn == 0.0 and not self.silent and self.newest is not None
        curvature = self.newest.curvature if steers and self.newest is not None else 0.0
        if curvature:
            if self._straight >= self._past_ticks:
                self._events.info("steers_aside", f"on an arc of {1.0 / abs(curvature):.2g} m")
            self._straight = 0
            return curvature * speed
        if self._straight < self._past_ticks:
            self._straight = self._straight + 1 if steers else self._past_ticks
            if self._straight == self._past_ticks:
                self._events.info("steered_aside", "")
        return turn

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
#
# An accelerometer sees at once whether Base comes along ahead, which gyroscope and wheels cannot
# tell where both wheels spin alike or both are pushed along: `GroundSpeed`.

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
"""Wheels grip again when they and what else tells of Base differ by less than this part of what
counts as slip [1]."""


WHEEL_SPEED: Final = 0.01
"""How exactly wheels that grip tell how fast Base goes, as standard deviation [m/s]."""
LEAST_NOISE: Final = 0.02
"""Of a sample of the accelerometer, as standard deviation [m/s²]; more where it shakes."""
SHAKES_S: Final = 0.5
"""That is a mean over about so long [s]."""
BIAS_WALK: Final = 0.001
"""How its bias, and the floor's slope, change [m/s² per root of a second]."""
FIRST_BIAS: Final = 0.01
"""How exactly a mean beside wheels that stand tells it, as standard deviation [m/s²]."""
DEVIATIONS: Final = 4.0
"""What wheels and filter differ by is slip beyond so many standard deviations [1]; they agree
again within one."""
LAG_S: Final = 0.5
"""What wheels told for so long before they are seen to slip is left out, too [s]."""
GRIPS_S: Final = 0.3
"""Wheels are believed again once they agreed for so long [s]."""
QUIET_S: Final = 1.0
"""Beside wheels that stand, an accelerometer that reads its bias for so long stands, too [s] ..."""
QUIET: Final = 0.01
"""... within this [m/s²]: on what is no slicker than 0.001 whatever slides is slowed by more."""
SLOPE_S: Final = 3.0
"""One that reads something else evenly for so long has another bias, or stands on a slope [s]."""


class GroundSpeed:
    """How fast a base goes ahead, by its wheels and an accelerometer on it.

    A Kalman filter of speed v and bias b (Bar-Shalom, Li & Kirubarajan 2001, section 5.2): v̇ = a −
    b, b a random walk; wheels measure v. What they tell beyond the innovation's gate (section 5.4)
    is slip, and left out: v is then the accelerometer's, from a little before on. Gravity is part
    of b: by the pitch that the gyroscope tells, b changes at −g ω_y.
    """

    def __init__(self, most: float, lever: Array, period_s: float) -> None:
        """Build it; wheels slip where they differ by more than `most` [m/s].

        `lever` (2,) [m] is from the point that turns on the spot to the unit, in Base's axes.
        """
        self._most, self._lever, self._period_s = most, lever, period_s
        self.slips = False
        """Base does not go as fast as its wheels roll."""
        self._bias = np.zeros(2)
        """Of the accelerometer ahead, with what gravity adds [m/s²], and of the pitch [rad/s]."""
        self._speed = self._spread = self._noise = 0.0
        """Speed [m/s], its variance, and that of a sample."""
        self._crossed, self._bias_spread = 0.0, math.inf
        """Covariance of speed and bias; variance of the bias, not finite before one is known."""
        self._before: Array | None = None
        self._agreed_s = 0.0
        self._lately = deque[tuple[float, float, float, float, float]](
            maxlen=round(LAG_S / period_s)
        )
        """Speed and bias as they were, and the wheels' speed, acceleration and pitch rate after."""
        self._beside = deque[tuple[float, float]](maxlen=round(SLOPE_S / period_s))
        """What it read beside wheels that stood, without its bias, the newest last."""

    def missed(self, felt: Array | None, wheels: float) -> float:
        """Return how much farther Base went in a period than wheels at a speed [m/s] say [m].

        0 where both agree. `felt` (6,) is specific force and angular rate in Base's axes; None:
        stale.
        """
        before, self._before = self._before, felt
        if felt is None or before is None:
            self._restart(wheels)
            return 0.0
        T, (x, y) = self._period_s, self._lever.tolist()
        ahead, pitch, turn = felt[[0, 4, 5]].tolist()
        # The unit is carried around the point that turns on the spot.
        ahead += turn * turn * x + float(felt[5] - before[5]) / T * y
        shakes = 0.5 * float(felt[0] - before[0]) ** 2
        self._noise += (shakes - self._noise) * T / SHAKES_S
        stands = abs(wheels) < STANDS
        if math.isinf(self._bias_spread):
            self._learn_first(ahead, pitch, stands)
            self._speed = wheels
            return 0.0
        self._lately.append((self._speed, float(self._bias[0]), wheels, ahead, pitch))
        missed = self._predict(ahead, pitch, wheels)
        off, spread = -missed / T, self._spread + WHEEL_SPEED**2
        most, far = (AGREES * self._most, 1.0) if self.slips else (self._most, DEVIATIONS)
        agrees = abs(off) <= max(most, far * math.sqrt(spread))
        self._agreed_s = self._agreed_s + T if agrees else 0.0
        if not self.slips and not agrees:
            self.slips, missed = True, self._again()
        elif self._agreed_s >= GRIPS_S:
            self.slips = False
        if not self.slips:
            self._beside.clear()
            self._correct(off, spread)
            if stands:
                self._bias[1] += (pitch - float(self._bias[1])) * T / BIAS_S
            return 0.0
        self._lately.clear()
        if self._rests(ahead, pitch, stands):
            self._restart(0.0)
        return missed

    def _again(self) -> float:
        """Go on from a little before by the accelerometer alone; return what wheels missed [m]."""
        self._speed, self._bias[0] = self._lately[0][:2]
        told = [(ahead, pitch, wheels) for _, _, wheels, ahead, pitch in self._lately]
        spreads = self._spread, self._crossed, self._bias_spread
        missed = sum(self._predict(*each) for each in told)
        self._spread, self._crossed, self._bias_spread = spreads
        return missed

    def _restart(self, speed: float) -> None:
        """Believe the wheels: they go at a speed [m/s]."""
        self._speed, self.slips, self._agreed_s = speed, False, 0.0
        self._beside.clear()
        self._lately.clear()
        if not math.isinf(self._bias_spread):
            self._spread, self._crossed = WHEEL_SPEED**2, 0.0
            self._bias_spread = FIRST_BIAS**2

    def _learn_first(self, ahead: float, pitch: float, stands: bool) -> None:
        """Take the mean over wheels that stand for the bias; until then they are believed."""
        if not stands:
            self._beside.clear()
            return
        self._beside.append((ahead, pitch))
        if len(self._beside) * self._period_s > STAND_S:
            self._bias = np.array(self._beside).mean(axis=0)
            self._bias_spread = 0.0
            self._restart(0.0)

    def _predict(self, ahead: float, pitch: float, wheels: float) -> float:
        """Go on by a period; return how much farther Base went than its wheels say [m]."""
        T = self._period_s
        gained = (ahead - float(self._bias[0])) * T
        self._speed += gained
        self._bias[0] += float(GRAVITY[2]) * (pitch - float(self._bias[1])) * T
        P, C, B = self._spread, self._crossed, self._bias_spread
        self._spread = P - 2.0 * T * C + T * T * (B + max(self._noise, LEAST_NOISE**2))
        self._crossed = C - T * B
        self._bias_spread = B + BIAS_WALK**2 * T
        return (self._speed - 0.5 * gained - wheels) * T

    def _correct(self, off: float, spread: float) -> None:
        """Take in what the wheels differ by [m/s], of a variance `spread`."""
        P, C = self._spread, self._crossed
        self._speed += P / spread * off
        self._bias[0] += C / spread * off
        self._spread, self._crossed = P - P * P / spread, C - P * C / spread
        self._bias_spread -= C * C / spread

    def _rests(self, ahead: float, pitch: float, stands: bool) -> bool:
        """Return whether wheels stand and the accelerometer says that Base stands with them.

        One that reads evenly something else has that as its bias from then on.
        """
        if not stands:
            self._beside.clear()
            return False
        self._beside.append((ahead, pitch))
        told, few = np.array(self._beside), 2 * round(0.5 * QUIET_S / self._period_s)
        if len(told) < few:
            return False
        halves = told[-few:, 0].reshape(2, -1).mean(axis=1) - self._bias[0]
        if float(np.abs(halves).max()) < QUIET:
            return True
        halves = told[len(told) % 2 :, 0].reshape(2, -1).mean(axis=1)
        if len(told) < (self._beside.maxlen or 0) or abs(float(halves[1] - halves[0])) > QUIET:
            return False
        self._bias = told.mean(axis=0)
        return True


class BaseTracker:
    """Tracks one base that rolls."""

    def __init__(
        self,
        section: DifferentialBaseSection,
        rolling: DifferentialDrive,
        T_world_base: Pose,
        period_s: float,
        events: Events,
        T_base_imu: Pose | None = None,
    ) -> None:
        """Build it; `T_base_imu` is where an inertial unit is on Base, None without."""
        self._section, self._rolling, self._period_s = section, rolling, period_s
        self._T_imu = T_base_imu
        at = np.zeros(3) if T_base_imu is None else T_base_imu.p
        lever = np.array([at[0] - rolling.centre, at[1]])
        self._ahead = GroundSpeed(section.slip_speed, lever, period_s)
        self._felt: Array | None = None
        """What the unit felt (6,), in Base's axes; None without."""
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
        self._slid = np.zeros(2)
        """Way ahead [m] and turn [rad] of the last second that the wheels missed."""
        self._own = np.zeros(2)
        """The same since the start: what a scanner tells of it is told already."""
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
        self._newest_slide = -1
        """Tick up to which it told how Base slid."""
        self._past = deque[tuple[int, Pose, Array]](maxlen=round(REMEMBERED_S / period_s))
        self._newest = -1

    @classmethod
    def from_cell(cls, cell: Cell, events: Events) -> Self | None:
        """Return the tracker of a loaded cell; None where nothing rolls."""
        c, rolling = cell.config, DifferentialDrive.from_cell(cell)
        if c.mechanism.base is None or rolling is None:
            return None
        place = c.mechanism.T_world_base
        T = Pose.from_xyz_rpy(place.xyz, place.rpy)
        imu, T_imu = c.mechanism.imu, None
        if imu is not None and imu.on == "base":
            T_imu = Pose.from_xyz_rpy(imu.T_on_imu.xyz, imu.T_on_imu.rpy)
        return cls(c.mechanism.base, rolling, T, c.timing.period_s, events, T_imu)

    def step(self, tick: int, told: Motion | None, q: Array) -> Body:
        """Return the base for the command of `tick`; joints are measured at q (n,) [rad]."""
        wheels, commanded = q[:2], None if told is None else told.q[:2]
        way = wheels - self.odometry.measured.wheels if self._begun else np.zeros(2)
        if commanded is None or not self._begun:
            self.odometry = self.odometry.forget(wheels, wheels)
            self._begun = True
        self._slid *= 1.0 - self._period_s / SLIPS_S
        off = self._missed_turn(way)
        ahead = self._missed_way(way)
        if commanded is None:
            off = ahead = self._turned_s = self._repeated = self._back = 0.0
        self.odometry = self.odometry.rolled(self._rolling, commanded, wheels)
        most = self._section.correction
        if self._back != 0.0:
            self.odometry = self.odometry.slid(self.odometry.measured, 0.0, 0.0, self._back)
            self._own[1] += self._back
            self._slid[1], self._back = 0.0, 0.0
        if off != 0.0 or ahead != 0.0:
            # It is moved by that, not told late of it: so it is as quickly right again.
            self.odometry = self.odometry.slid(self.odometry.measured, ahead, 0.0, off)
            self._own += ahead, off
            more = np.abs((ahead, off)) / self._period_s
            most = most[0] + float(more[0]), most[1] + float(more[1])
        self.odometry, self.twist = self.odometry.corrected(most, self._period_s)
        self._past.append((tick, self.odometry.measured, self._own.copy()))
        if self._told is not None and (tick - self._told) * self._period_s > REMEMBERED_S:
            self.slipping = False
        moved = off != 0.0 or ahead != 0.0
        if moved or (self.slips and (self._told is not None or self._T_imu is not None)):
            self._judge(*sizes(self.odometry.drift))
        return self.odometry.body(self.twist)

    def take_inertial(self, felt: Array | None) -> None:
        """Take in specific force and rate (6,) by the unit on Base, in its axes; None: stale."""
        self._rate_before, self._rate, self._felt = self._rate, None, None
        if felt is not None and self._T_imu is not None:
            R = self._T_imu.R
            self._rate = float(R[2] @ felt[3:])
            self._felt = np.concatenate((R @ felt[:3], R @ felt[3:]))

    def _missed_way(self, way: Array) -> float:
        """Return by how much farther Base went ahead than wheels did on a `way` (2,) [m]."""
        wheels = self._rolling.driven(way)[0] / self._period_s
        missed = self._ahead.missed(self._felt, wheels)
        self._slid[0] += missed
        return missed

    def _missed_turn(self, way: Array) -> float:
        """Return by how much more Base turned than wheels did on a `way` (2,) [rad]; 0 for agreed.

        While the wheels stand, the gyroscope's bias is learnt; while they go straight, followed.
        """
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
            self._slid[1] += off * self._period_s
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
        found = next(((T, own) for then, T, own in self._past if then == tick), None)
        if slide is None or found is None:
            return
        # The scanner compares with the wheels alone: what was made up for since then is none.
        T_then, own = found
        since = next(own for then, _, own in self._past if then >= self._newest_slide)
        self._newest_slide = tick
        x, yaw = own - since
        self.odometry = self.odometry.slid(T_then, slide[0] - x, slide[1], slide[2] - yaw)
        self._judge(*sizes(self.odometry.drift))

    def _at(self, tick: int) -> Pose | None:
        """Return where the odometry had Base at a tick; None for news that is not newer."""
        if tick <= self._newest:
            return None
        found = next((T for then, T, _ in self._past if then == tick), None)
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
        slid, also = np.abs(self._slid).tolist()
        off, turned = max(off, slid), max(turned, also)
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
