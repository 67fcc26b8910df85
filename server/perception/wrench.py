"""The measured wrench: silent or saturated, its mean, and a load that nobody explained."""

import math
from collections import deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from ...config.schema.mechanism import ForceTorqueSection
from ...config.schema.sources import FollowingSection
from ...drivers.device import Cause
from ..commands.settings import OperatorSettings
from ..control.bodies.rates import ArmTick
from ..control.inputs import STILL as STILL_DRIVE
from ..control.inputs import Payload
from ..control.spatial import GRAVITY, Array, Pose, cross, nonzero, rotation_log, sizes
from ..control.task.following import STAYS_S
from ..control.task.task import GAIN_TIME_S
from ..events import Events, Value
from ..mode import Mode
from ..plant import UnitReading
from ..stability.judgement import WRENCH_SOURCES
from .contact import ToolContact
from .filters import UNKNOWN_LOAD, LoadUncertainty

# --- Force/torque monitor: tells when the sensor falls silent or saturates, averages it for a tare

TARE_S = 0.3
"""A tare averages the sensor over this time [s]."""

STILL = 1e-3
"""An arm stands for a tare while every joint stayed within this over that time [rad, m].

Force control follows the sensor's noise: where it is on, no command is ever quite zero. Within this
a tool moves by millimetres a second, so that no force of inertia counts, and weight is known.
"""

ASKED = np.array([1e-3] * 3 + [2e-3] * 3)
"""And while nothing but the sensor itself asks for more than this (6,) [m/s, rad/s].

What a stick pushes against a wall stands, too: its push is what force control and stick agree on.
"""

NAME = "force_torque"

WEIGHED = 0.1
"""Part of a payload's weight by which the reading may be off [1]."""

LONGEST = 0.5
"""Centres of mass of tools are nearer to the sensor [m]."""


def others_ask(twists: Mapping[str, Array], than: Collection[str] = WRENCH_SOURCES) -> bool:
    """Return whether other sources than these ask for motion; `twists` by source."""
    asked = np.zeros(6)
    for name, twist in twists.items():
        if name not in than:
            asked += twist
    return bool((np.abs(asked) > ASKED).any())


def reads_weight(left: Array, payload: Payload) -> bool:
    """Return whether a reading is a payload's weight, if (6,) is left of it without that [N, N·m].

    One that weighs little, or has its centre farther than a tool reaches, is not told from none.
    """
    weight, lever = -float(GRAVITY[2]) * payload.mass, float(np.linalg.norm(payload.com))
    if weight < 2.0 * UNKNOWN_LOAD.force or lever > LONGEST:
        return False
    force, moment = sizes(left)
    within = max(UNKNOWN_LOAD.moment, WEIGHED * weight * lever)
    return force <= max(UNKNOWN_LOAD.force, WEIGHED * weight) and moment <= within


class _Loaded(NamedTuple):
    """A reading (6,), where the tool was, and what was told of its load."""

    wrench: Array
    T_world_mrf: Pose
    T_wrist_mrf: Pose
    """Of the MRF that the tick was about: arms that hold a payload have another one."""
    payload: Payload | None
    bias: Array


class ForceTorqueMonitor:
    """Monitors the sensor of a cell; if it is `essential`, the arm does not move without it.

    `weight` returns what a payload alone makes the sensor read (6,), see `Wrist.weight`.
    """

    def __init__(
        self,
        events: Events,
        essential: bool,
        period_s: float,
        weight: Callable[[Pose, Pose, Payload | None, Array], Array],
    ) -> None:
        self._events, self._weight = events, weight
        self.essential = essential
        self._stale: str | None = None
        """The event that told why there is no reading; None while there is one."""
        self.stale = False
        # Of the last ticks, for a tare: it judges them when it is asked for.
        self._loaded: deque[_Loaded] = deque(maxlen=round(TARE_S / period_s))
        self._stood: deque[tuple[Array | None, Mapping[str, Array]]] = deque(
            maxlen=round(TARE_S / period_s)
        )
        """Where the joints were (n,), and what each source asked for."""

    def update(
        self, reading: UnitReading, output: ArmTick | None, payload: Payload | None, bias: Array
    ) -> None:
        """Take in a reading, the tick before, and the payload and bias (6,) that are told now."""
        self._stood.append((reading.q, {} if output is None else output.twists))
        trouble, stale = reading.wrench_trouble, None
        if reading.wrench is None:
            saturated = trouble is not None and trouble.cause is Cause.SATURATED
            stale = "sensor_saturated" if saturated else "sensor_stale"
        if stale is None and self._stale is not None:
            self._events.info("sensor_fresh", NAME)
        elif stale == "sensor_stale" and self._stale != stale:
            self._events.warning(stale, NAME, age_s=reading.wrench_age_s)
        elif stale is not None and trouble is not None and self._stale != stale:
            self._events.warning(stale, f"{NAME}: {trouble.detail}", **trouble.values)
        self._stale, self.stale = stale, stale is not None
        if reading.wrench is None:
            self._loaded.clear()
        elif output is not None:
            at = output.T_world_mrf_measured, output.T_wrist_mrf
            self._loaded.append(_Loaded(reading.wrench, *at, payload, bias))

    @property
    def unloaded(self) -> Array | None:
        """The mean reading (6,) less the payload's weight [N, N·m]; None before there is one."""
        if len(self._loaded) < (self._loaded.maxlen or 0):
            return None
        return np.asarray(np.mean([x.wrench - self._weight(*x[1:]) for x in self._loaded], axis=0))

    @property
    def still(self) -> bool:
        """True while the arm stands well enough for a tare."""
        q = [q for q, twists in self._stood if q is not None and not others_ask(twists)]
        if len(q) < (self._stood.maxlen or 0):
            return False
        return bool((np.ptp(np.array(q), axis=0) < STILL).all())


# --- Text and values of the event `load_unexplained` ----------------------------------------------


def explanation(wrench: Array, unloaded: Array | None) -> tuple[str, dict[str, Value]]:
    """Return what to say of a wrench (6,) in World axes, and its values.

    `unloaded` (6,) is the sensor's reading, exerted sign, without the payload's weight: the bias
    that would explain it.
    """
    force, moment = sizes(wrench)
    up = float(wrench[2])
    tilt = math.degrees(math.acos(min(1.0, abs(up) / force))) if force > 0.0 else 90.0
    mass = up / -float(GRAVITY[2])
    values: dict[str, Value] = {
        "force_n": force,
        "moment_nm": moment,
        "force_world": str(np.round(wrench[:3], 2).tolist()),
        "moment_world": str(np.round(wrench[3:], 3).tolist()),
        "mass_kg": mass,
        "off_vertical_deg": tilt,
    }
    less = "more" if mass >= 0.0 else "less"
    words = f"{abs(mass):.2f} kg {less} than was told would, {tilt:.0f} deg off the vertical"
    if unloaded is not None:
        bias = np.round(-unloaded, 3).tolist()
        values["bias"] = str(bias)
        words += f"; or a bias of {bias}"
    return (
        f"{force:.1f} N and {moment:.2f} N·m that no contact explains: {words}. Force control and "
        "following wait for a tare, the payload, or an acknowledgement",
        values,
    )


# --- Moving average of the measured wrench, in World axes -----------------------------------------

AVERAGE_S = 0.2
"""The measured wrench is averaged over this time [s]."""
NEWEST = 5
"""And over so many ticks where it is to be known how it changes [1]."""
NO_BOUNDS = np.full(2, np.inf)


@dataclass(frozen=True)
class WrenchMark:
    """Pose of the tool, and the wrench that was measured there."""

    T: Pose
    sizes: Array
    """Of force and moment (2,) [N, N·m]."""
    directions: Array
    """Unit vectors of both in World (2, 3)."""

    def backed(self, T: Pose) -> Array:
        """Return how far a tool at a pose has given way to either (2,) [m, rad]."""
        way, turn = T.p - self.T.p, rotation_log(T.R @ self.T.R.T)
        return -np.array([way @ self.directions[0], turn @ self.directions[1]])

    def changed(self, now: "WrenchMark", grown: Array) -> Array:
        """Return by how much force and moment have changed (2,) [N, N·m].

        Apart from what either has grown by, up to `grown` (2,).
        """
        off = now.sizes[:, None] * now.directions - self.sizes[:, None] * self.directions
        more = np.clip((off * self.directions).sum(axis=1), 0.0, grown)
        return np.asarray(np.sqrt(((off - more[:, None] * self.directions) ** 2).sum(axis=1)))


class AveragedWrench:
    """Average of the newest wrenches; below `bounds` (2,) [N, N·m] the tool counts as unloaded."""

    def __init__(self, most: int, bounds: Array = NO_BOUNDS) -> None:
        """Build it for so many wrenches."""
        self._bounds = bounds
        self.rows = np.zeros((most, 6))
        """The newest wrenches, the last of them last; only the `count` last ones are known."""
        self.count = 0
        """So many of them are known [1]."""

    def clear(self) -> None:
        """Forget: the sensor is stale."""
        self.count = 0

    def add(self, wrench: Array) -> None:
        """Take in the wrench (6,) of a tick, in World axes."""
        rows = self.rows
        rows[:-1] = rows[1:]
        rows[-1] = wrench
        self.count = min(self.count + 1, len(rows))

    def mean(self) -> Array:
        """Return the mean wrench (6,)."""
        return self._mean(self.count)

    def now(self) -> Array:
        """Return the mean wrench (6,) of the last few ticks."""
        return self._mean(min(self.count, NEWEST))

    def mark(self, output: ArmTick) -> WrenchMark:
        """Return where the tool is, and what is measured now."""
        mean = self.now()
        size = np.array(sizes(mean))
        directions = mean.reshape(2, 3) / np.maximum(size, 1e-9)[:, None]
        return WrenchMark(output.T_world_mrf_measured, size, directions)

    def sizes(self) -> Array:
        """Return the sizes (2,) of mean force and moment [N, N·m]."""
        return np.array(sizes(self.mean()))

    def quiet(self) -> bool:
        """Return whether neither is beyond its bound."""
        return self.count > 0 and bool((self.sizes() <= self._bounds).all())

    def _mean(self, newest: int) -> Array:
        """Return the mean (6,) of so many wrenches, nothing of none."""
        return np.asarray(self.rows[-newest:].mean(axis=0)) if newest else np.zeros(6)


# --- Load monitor: tells contact from a load that nobody explained, before force control acts on it
#
# A payload that is told wrong, or a sensor that is biased, reads like contact in the air: the
# arm would back away from it for ever. Contact gives way when the arm does, a load does not:
# what is measured beyond the cell's `unexplained_force` or `unexplained_moment` when the arm is
# enabled, the sources of the sensor are switched on, or what hangs on the sensor is told anew,
# is backed away from slowly, and has to fall by `STIFFNESS` on the way. Otherwise it is said,
# `load_unexplained`, and those sources wait until the sensor is tared, the payload is told, or
# an operator acknowledges. Meanwhile the size of what is measured stands for contact: no
# attitude changes that.
#
# Less than these bounds is force control's to answer, and so is what comes later. Of a sensor's
# zero that drifts, or of a little load, it would be answered for ever: 3 N lead a tool by 2 mm/s.
# So what alone has led the tool by a step, and has stayed the same for as long as no hand does
# (below), is taken for the sensor's own, as by a tare: within the bounds of what was told last.

SETTLE_S = 0.3
"""After brakes have opened, joints settle for this long [s]."""
RAMPED_S = 5.0 * GAIN_TIME_S
"""A payload or bias that is told anew is in effect after this time [s]."""
WAIT_S = 3.0
"""So long it is waited for an answer while nothing else is asked of the arm [s]."""
SPEED = np.array([5e-3, 25e-3])
"""The tool backs away no faster, unless something else is asked of it [m/s, rad/s]."""
SURER = 4.0
"""Once it has fallen on the way, the tool goes on so many times as fast, and as far [1]."""
STEP = np.array([1e-3, 5e-3])
"""After every step back of that size it is judged [m, rad]."""
STIFFNESS = np.array([1e3, 20.0])
"""The softest contact falls by so much for each unit of it [N/m, N·m/rad]."""
SAME = 0.1
"""A load that was acknowledged may be off by that part when it is met again [1]."""
UNCHANGED = 0.5 * STEP * STIFFNESS
"""What changes by less while it leads the tool counts as the same [N, N·m]."""
DRIFT = np.array([0.3, 0.03])
"""Nor does what grows no faster, as a zero that drifts [N/s, N·m/s]."""
WATCHED_S = 0.05
"""It is looked at so often [s]."""
FORCE = ("force",)


class LoadTrust(StrEnum):
    """Judgement of the measured load."""

    EXPLAINED = "explained"
    SETTLING = "settling"
    JUDGED = "judged"
    """The arm backs away from it, to see whether it falls."""
    UNEXPLAINED = "unexplained"
    UNKNOWN = "unknown"
    """An operator said that it is not known."""
    ACKNOWLEDGED = "acknowledged"


LATCHED = (LoadTrust.UNEXPLAINED, LoadTrust.UNKNOWN)
"""Force control waits for an operator."""


class LoadMonitor:
    """Judges what the force/torque sensor of one cell carries; idle in a cell without one."""

    def __init__(
        self,
        sensor: ForceTorqueSection | None,
        read: ForceTorqueMonitor,
        damping: float,
        period_s: float,
        settings: OperatorSettings,
        events: Events,
    ) -> None:
        """Begin with a load that is explained.

        `read` knows what the sensor reads, `damping` is that of following a hand [N·s/m].
        """
        self._read, self._events, self._settings = read, events, settings
        self._bounds = NO_BOUNDS
        if sensor is not None:
            self._bounds = np.array([sensor.unexplained_force, sensor.unexplained_moment])
        self._idle = sensor is None
        self._damping = damping
        self._measured = AveragedWrench(max(2, round(AVERAGE_S / period_s)), self._bounds)
        self.trust, self._until_s = LoadTrust.EXPLAINED, 0.0
        self._mark: WrenchMark | None = None
        self._falls = self._vouched = False
        self._using, self._mode = False, Mode.BOOT
        self._told = settings.load_told
        self._known = np.zeros(2)
        """Sizes of the load that is unexplained, unknown or acknowledged (2,) [N, N·m]."""
        self._carried = False
        """The drives carried what was measured when it was judged: then it is no bias."""
        self._lever = 0.0
        """From the MRF to the Sensor [m]."""
        self._tared = np.zeros(2)
        """Sizes of what a tare took for the sensor's own, and may be weight (2,) [N, N·m]."""
        self._zero = self._own_tare = settings.wrench_bias
        """The reading of no contact (6,) that was told last, and the one that is in force since."""
        self._since_s = self._watched_s = 0.0
        """When what leads the tool alone came to be as it is, and when it was looked at."""
        self._contact = ToolContact(period_s)
        self._latched = False
        """The contact of the tool was looked at a tick ago."""

    # --- what others ask ---------------------------------------------------------------------

    @property
    def doubt(self) -> LoadUncertainty | None:
        """Error bounds of the sensor's load, for collision detection; None: it is trusted."""
        off, turned = self._tared, 0.0
        if self.trust is LoadTrust.EXPLAINED and not nonzero(off):
            return None
        if self.trust is not LoadTrust.EXPLAINED:
            turned = UNKNOWN_LOAD.angle
            judged = self.trust in (LoadTrust.UNEXPLAINED, LoadTrust.ACKNOWLEDGED)
            if self.trust is not LoadTrust.UNKNOWN and not (judged and self._carried):
                off = off + np.maximum(self._known, self._measured.sizes())
            off = off + UNKNOWN_LOAD[:2]
        # What is known of it was measured at the MRF.
        force, moment = off.tolist()
        return LoadUncertainty(force, moment + self._lever * force, turned)

    @property
    def tool(self) -> ToolContact | None:
        """Contact of the tool, by the size of a load; None while that is explained, or judged."""
        return self._contact if self.trust in LATCHED else None

    @property
    def touched(self) -> bool:
        """True while something touches the tool, by the size of a load that is not explained."""
        return self._contact.touched

    # --- every tick --------------------------------------------------------------------------

    def update(
        self,
        output: ArmTick | None,
        wrench: Array | None,
        mode: Mode,
        time_s: float,
        carried: bool,
    ) -> None:
        """Take in what the tick before made of the sensor's reading: a `wrench` (6,), World axes.

        `carried` says that the drives carry what the sensor reads.
        """
        if self._idle or output is None:
            return
        settings, measured = self._settings, self._measured
        if self.trust in (LoadTrust.EXPLAINED, LoadTrust.SETTLING, LoadTrust.JUDGED):
            self._carried = carried
        before, self._mode = self._mode, mode
        moving, stale = mode is Mode.ENABLED, measured.count == 0
        began = moving and before is not Mode.ENABLED
        if wrench is None:
            measured.clear()
            self._using = False
        else:
            measured.add(wrench)
            using = moving and any(map(settings.on.get, WRENCH_SOURCES))
            if began:
                self._vouched = measured.quiet()
            # Once it was explained, what comes while a source was off, or the sensor, is contact.
            anew = (stale or not self._using) and not self._vouched
            if using and (began or anew):
                self._begin(time_s, before.energised)
            self._using = using
        if settings.load_told != self._told:
            self._hear(output, time_s)
        if self._using and self.trust in (LoadTrust.SETTLING, LoadTrust.JUDGED):
            self._judge(output, time_s)
        elif self._using and self.trust is LoadTrust.EXPLAINED and settings.on["force"]:
            self._watch(output, time_s)
        settings.load_settles &= self.trust is LoadTrust.SETTLING
        settings.sensor_share = self._share(output)
        before_latched, self._latched = self._latched, self.trust in LATCHED
        if self._latched:
            known, weight = float(self._known[0]), self._weight()
            self._contact.update(known, measured.now(), weight, output, moving)
        elif before_latched:
            self._contact.rest()

    def _hear(self, output: ArmTick, time_s: float) -> None:
        """Notice what operators said of the load since the tick before."""
        self._told, heard = self._settings.load_told, self._settings.load_heard
        self._lever = self._apart(output)
        if self._settings.wrench_bias is not self._own_tare:
            self._zero = self._own_tare = self._settings.wrench_bias
        if heard == "unknown":
            self.trust, self._known = LoadTrust.UNKNOWN, self._measured.sizes()
            self._events.warning("load_unknown", "force control waits until the payload is told")
        elif heard == "acknowledged":
            if self.trust is not LoadTrust.EXPLAINED:
                self.trust, self._known = LoadTrust.ACKNOWLEDGED, self._measured.sizes()
                self._events.warning("load_acknowledged", "", force_n=float(self._known[0]))
        else:
            quiet = self._measured.quiet()
            self._tared = np.zeros(2) if quiet or heard != "tare" else self._measured.sizes()
            # What was quiet may have been told wrong; contact that is under way stays contact.
            if self.trust is not LoadTrust.EXPLAINED or quiet:
                self.trust, self._until_s = LoadTrust.SETTLING, time_s + RAMPED_S
                self._settings.load_settles = quiet

    def _begin(self, time_s: float, energised: bool) -> None:
        """Begin to judge; brakes of an arm that was not `energised` have just opened."""
        if self.trust is LoadTrust.UNKNOWN:
            return
        if self._measured.quiet():
            self.trust = LoadTrust.EXPLAINED
        elif energised and self.trust is LoadTrust.UNEXPLAINED:
            # Nothing was told of it, whatever the arm has touched since: it is not tried again.
            self._say(None)
        elif self.trust in (LoadTrust.UNEXPLAINED, LoadTrust.ACKNOWLEDGED) and self._met_again():
            if self.trust is LoadTrust.UNEXPLAINED:
                self._say(None)
        else:
            self.trust = LoadTrust.SETTLING
            self._until_s = time_s + (0.0 if energised else SETTLE_S)

    def _judge(self, output: ArmTick, time_s: float) -> None:
        if self.trust is LoadTrust.SETTLING and (
            time_s >= self._until_s or others_ask(output.twists)
        ):
            if self._measured.quiet():
                self._end(LoadTrust.EXPLAINED)
            else:
                self._start_probe(output, time_s)
        elif self.trust is LoadTrust.JUDGED:
            self._probe(output, time_s)

    def _start_probe(self, output: ArmTick, time_s: float) -> None:
        self.trust, self._mark = LoadTrust.JUDGED, self._measured.mark(output)
        self._until_s = time_s + WAIT_S
        self._lever, self._falls = self._apart(output), False

    def _probe(self, output: ArmTick, time_s: float) -> None:
        mark, here = self._mark, self._measured.mark(output)
        if self._measured.quiet():
            self._end(LoadTrust.EXPLAINED)
        elif mark is not None:
            which = 0 if here.sizes[0] > self._bounds[0] else 1
            back = float(mark.backed(here.T)[which])
            if back >= STEP[which] * (SURER if self._falls else 1.0):
                if mark.sizes[which] - here.sizes[which] < STIFFNESS[which] * back:
                    self._doubt(output)
                else:
                    self._start_probe(output, time_s)
                    self._falls = True
            elif others_ask(output.twists):
                self._until_s = time_s + WAIT_S
            elif time_s > self._until_s:
                self._doubt(output)

    def _watch(self, output: ArmTick, time_s: float) -> None:
        """Take what leads the tool through the air, and does not change, for the sensor's own."""
        if time_s < self._watched_s:
            return
        lapsed = time_s > self._watched_s + WATCHED_S
        self._watched_s = time_s + WATCHED_S
        mark, here = self._mark, self._measured.mark(output)
        inputs = output.inputs
        led = output.by_joint or inputs.wrench_desired.any() or inputs.drive != STILL_DRIVE
        others = led or others_ask(output.twists, FORCE)
        grown = DRIFT * (time_s - self._since_s)
        if mark is None or lapsed or others or (mark.changed(here, grown) > UNCHANGED).any():
            self._mark, self._since_s = here, time_s
            return
        hangs, for_s = abs(here.directions[0, 2]) >= VERTICAL, time_s - self._since_s
        if for_s < (HANGS_S if hangs else STAYS_S):
            return
        gain = self._settings.gains["force"]
        rate = here.sizes * np.array([gain[:3].max(), gain[3:].max()])
        went = np.minimum(mark.backed(here.T), rate * for_s)
        if (went < STEP).all() or (unloaded := self._read.unloaded) is None:
            return
        self._mark = None
        if (np.array(sizes(unloaded - self._zero)) > self._bounds).any():
            self._doubt(output)
            return
        self._settings.wrench_bias = self._own_tare = unloaded
        words, values = unchanging(self._measured.mean(), float(UNCHANGED[0]))
        self._events.warning("force_unchanging", f"{words}, and led the tool: tared", **values)

    def _apart(self, output: ArmTick) -> float:
        place = self._settings.T_wrist_sensor
        return 0.0 if place is None else float(np.linalg.norm(output.T_wrist_mrf.p - place.p))

    def _end(self, trust: LoadTrust) -> None:
        self.trust, self._mark, self._until_s = trust, None, 0.0
        self._vouched = trust is LoadTrust.EXPLAINED

    def _doubt(self, output: ArmTick) -> None:
        self._end(LoadTrust.UNEXPLAINED)
        self._known, self._lever = self._measured.sizes(), self._apart(output)
        self._say(self._read.unloaded)

    def _say(self, unloaded: Array | None) -> None:
        detail, values = explanation(self._measured.mean(), unloaded)
        self._events.warning("load_unexplained", detail, **values)

    # --- what is measured --------------------------------------------------------------------

    def _met_again(self) -> bool:
        off = np.abs(self._measured.sizes() - self._known)
        return bool((off <= np.maximum(self._bounds, SAME * self._known)).all())

    def _weight(self) -> float:
        payload = self._settings.payload
        return 0.0 if payload is None else 9.81 * payload.mass

    def _share(self, output: ArmTick) -> float:
        """Return the part of their gains that the sensor's sources act with: 0 while they wait."""
        trust = self.trust
        if trust is LoadTrust.SETTLING or trust in LATCHED:
            return 0.0
        if trust is not LoadTrust.JUDGED:
            known = self._mode.energised or trust is LoadTrust.ACKNOWLEDGED
            return 1.0 if known or self._measured.quiet() else 0.0
        # Nothing acts before the arm is enabled, and nothing shall in the first tick.
        if self._mode is not Mode.ENABLED:
            return 0.0
        if others_ask(output.twists):
            return 1.0
        settings, (force, moment) = self._settings, self._measured.sizes()
        rate = np.zeros(2)
        if settings.on["force"]:
            gain = settings.gains["force"]
            rate += gain[:3].max() * force, gain[3:].max() * moment
        if settings.on["following"]:
            rate += force / self._damping, 0.0
        most = SPEED * (SURER if self._falls else 1.0)
        return float(min(1.0, (most / np.maximum(rate, 1e-12)).min()))


# --- Following a hand: the part of the measured force that is nobody's, because it does not change
#
# A load or a bias that was told a little wrong reads like a light hand, below the bounds of
# `wrench.py`: it would lead the tool away for ever, 0.2 kg at 20 N·s/m by 0.1 m/s. A
# hand is known by its changes. So what was there before the arm was enabled, and what has
# stayed the same for `STAYS_S` (`HANGS_S`, where it is vertical as a weight is), is nobody's:
# it is not followed, as long as nothing else is measured (`following.py`).
# Any other wrench is followed whole and at once. Changes below half of the deadband are the
# sensor's noise, no hand's.

HANGS_S = 1.0
"""Nor the same vertical one, which a weight is; nor is there one that presses nothing [s]."""
VERTICAL = math.cos(math.radians(10.0))
"""Cosine of the angle to the vertical within which a force may be a weight [1]."""
STEADY = 0.5
"""Within that part of the deadband of following a wrench counts as the same [1]."""
BLOCK = 5
"""The measured wrench is averaged over so many ticks [1]."""


def unchanging(wrench: Array, least_n: float) -> tuple[str, dict[str, Value]]:
    """Return text and values of the event `force_unchanging`, for a wrench (6,) in World axes.

    One whose force is `least_n` or less is no weight.
    """
    force, moment = sizes(wrench)
    weight = float(wrench[2])
    words = f"{force:.2g} N and {moment:.2g} N·m do not change, as a hand's do"
    if force > least_n and abs(weight) >= VERTICAL * force:
        words += f"; {weight / -float(GRAVITY[2]):+.2g} kg that nobody told of would be these"
    return words, {"force_n": force, "moment_nm": moment}


class UnchangingForce:
    """Learns what one arm's sensor reads while nobody leads the tool."""

    def __init__(
        self,
        section: FollowingSection,
        settings: OperatorSettings,
        period_s: float,
        events: Events,
    ) -> None:
        self._settings, self._events = settings, events
        self._deadband = np.array([section.deadband, section.moment_deadband])
        self._per_s = 1.0 / (BLOCK * period_s)
        self._newest = AveragedWrench(BLOCK)
        self._blocks = AveragedWrench(round(STAYS_S * self._per_s))
        self._ticks = 0
        self._T_wrist_mrf: Pose | None = None
        self._learned = np.zeros(6)
        self._nobodys: Array | None = None
        """The parts of that (6,) that are beyond the deadband; None: neither is."""
        self._said = np.zeros(6)

    def update(
        self, output: ArmTick | None, wrench: Array | None, mode: Mode, trust: LoadTrust
    ) -> Array | None:
        """Take in the tick before; return the wrench (6,) that is nobody's, in World axes.

        `wrench` (6,) is what that saw the tool exert at the MRF, in World axes; it is kept, and
        carried to other MRFs. None: there is none beyond the deadband, or a load that no contact
        explains is judged, or waits for an operator.
        """
        if output is None or trust is LoadTrust.JUDGED or trust in LATCHED:
            self._forget()
            return None
        if wrench is None:
            self._newest.clear()
            self._blocks.clear()
        else:
            if output.T_wrist_mrf is not self._T_wrist_mrf:
                self._carry(output)
            self._newest.add(wrench)
            self._ticks += 1
            if self._ticks % BLOCK == 0:
                self._learn(mode.energised and trust is not LoadTrust.SETTLING)
        if self._nobodys is not None and mode is Mode.ENABLED and self._settings.on["following"]:
            self._tell()
        return self._nobodys

    def _forget(self) -> None:
        self._newest.clear()
        self._blocks.clear()
        self._learned, self._said, self._nobodys = np.zeros(6), np.zeros(6), None

    def _know(self, learned: Array) -> None:
        """Take a wrench (6,) for nobody's, as far as it is beyond the deadband."""
        self._learned = learned
        acts = np.array(sizes(learned)) > self._deadband
        self._nobodys = learned * np.repeat(acts, 3) if acts.any() else None

    def _carry(self, output: ArmTick) -> None:
        """Bring what was measured at another MRF, in the Wrist, to that of now."""
        before, now = self._T_wrist_mrf, output.T_wrist_mrf
        self._T_wrist_mrf = now
        if before is None or np.array_equal(before.p, now.p):
            return
        lever = output.T_world_mrf_measured.R @ now.R.T @ (before.p - now.p)
        for wrench in (self._learned, *self._newest.rows, *self._blocks.rows):
            wrench[3:] += cross(lever, wrench[:3])
        self._know(self._learned)

    def _learn(self, followed: bool) -> None:
        """Take in one more block of the newest wrenches."""
        newest = self._newest.mean()
        self._blocks.add(newest)
        if not followed:
            # The brakes hold, or a load is told: what is read now is there before it is followed.
            self._know(newest)
            return
        force, up = sizes(newest)[0], abs(float(newest[2]))
        hangs = force <= self._deadband[0] or up >= VERTICAL * force
        count = round((HANGS_S if hangs else STAYS_S) * self._per_s)
        if self._blocks.count < count:
            return
        last = self._blocks.rows[-count:]
        off = np.linalg.norm((last - newest).reshape(count, 2, 3), axis=2).max(axis=0)
        leads = self._settings.gains["following"].reshape(2, 3).any(axis=1)
        if not (leads & (off > STEADY * self._deadband)).any():
            self._know(last.mean(axis=0))

    def _tell(self) -> None:
        off = np.array(sizes(self._learned - self._said))
        if not (off > self._deadband).any():
            return
        self._said = self._learned.copy()
        words, values = unchanging(self._learned, float(self._deadband[0]))
        self._events.warning("force_unchanging", words, **values)
