"""Load monitor: tells contact from a load that nobody explained, before force control acts on it.

A payload that is told wrong, or a sensor that is biased, reads like contact in the air: the arm
would back away from it for ever. Contact gives way when the arm does, a load does not: what is
measured beyond the cell's `unexplained_force` or `unexplained_moment` when the arm is enabled, the
sources of the sensor are switched on, or what hangs on the sensor is told anew, is backed away from
slowly, and has to fall by `STIFFNESS` on the way. Otherwise it is said, `load_unexplained`, and
those sources wait until the sensor is tared, the payload is told, or an operator acknowledges.
Meanwhile the size of what is measured stands for contact: no attitude changes that.
"""

from enum import StrEnum

import numpy as np

from ...config.schema.mechanism.mechanism import ForceTorqueSection
from ..commands.settings import OperatorSettings
from ..control.spatial import Array, rotation_log
from ..control.state import Output
from ..control.task.gains import GAIN_TIME_S
from ..mode import Mode
from ..runtime.events import Events
from ..stability.gains import WRENCH_SOURCES
from .contact.tool import ToolContact
from .filters.collision import UNKNOWN_LOAD, LoadUncertainty
from .force_torque import ForceTorqueMonitor, others_ask
from .load_words import explanation
from .mean_wrench import AveragedWrench, WrenchMark

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
        self._bounds = np.full(2, np.inf)
        if sensor is not None:
            self._bounds = np.array([sensor.unexplained_force, sensor.unexplained_moment])
        self._idle = sensor is None
        self._damping = damping
        self._measured = AveragedWrench(self._bounds, period_s)
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
        self._contact = ToolContact(period_s)

    # --- what others ask ---------------------------------------------------------------------

    @property
    def doubt(self) -> LoadUncertainty | None:
        """Error bounds of the sensor's load, for collision detection; None: it is trusted."""
        off, turned = self._tared, 0.0
        if self.trust is LoadTrust.EXPLAINED and not off.any():
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
        output: Output | None,
        mode: Mode,
        time_s: float,
        carried: bool,
    ) -> None:
        """Take in what the tick before made of the sensor's reading.

        `carried` says that the drives carry what the sensor reads.
        """
        if self._idle or output is None:
            return
        if self.trust in (LoadTrust.EXPLAINED, LoadTrust.SETTLING, LoadTrust.JUDGED):
            self._carried = carried
        before, self._mode = self._mode, mode
        moving, stale = mode is Mode.ENABLED, not self._measured.known
        began = moving and before is not Mode.ENABLED
        if output.wrench_mrf is None:
            self._measured.clear()
            self._using = False
        else:
            self._measured.add(output.wrench_mrf, output)
            using = moving and any(self._settings.on[s] for s in WRENCH_SOURCES)
            if began:
                self._vouched = self._measured.quiet()
            # Once it was explained, what comes while a source was off, or the sensor, is contact.
            anew = (stale or not self._using) and not self._vouched
            if using and (began or anew):
                self._begin(time_s, before.energised)
            self._using = using
        self._hear(output, time_s)
        if self._using and self._measured.known:
            self._judge(output, time_s)
        self._settings.load_settles &= self.trust is LoadTrust.SETTLING
        self._settings.sensor_share = 0.0 if self._waits() else self._share(output)
        if self.trust not in LATCHED:
            self._contact.rest()
            return
        known, weight = float(self._known[0]), self._weight()
        self._contact.update(known, self._measured.now(), weight, output, moving)

    def _waits(self) -> bool:
        """Return whether force control is not to act now."""
        if self.trust is LoadTrust.SETTLING or self.trust in LATCHED:
            return True
        # Nothing acts before the arm is enabled, and nothing shall in the first tick.
        if self.trust is LoadTrust.JUDGED:
            return self._mode is not Mode.ENABLED
        told = self.trust is LoadTrust.ACKNOWLEDGED or self._measured.quiet()
        return not (self._mode.energised or told)

    def _hear(self, output: Output, time_s: float) -> None:
        """Notice what operators said of the load since the tick before."""
        told = self._settings.load_told
        if told == self._told:
            return
        self._told, heard = told, self._settings.load_heard
        self._lever = self._apart(output)
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

    def _judge(self, output: Output, time_s: float) -> None:
        if self.trust is LoadTrust.SETTLING and (
            time_s >= self._until_s or others_ask(output.twists)
        ):
            if self._measured.quiet():
                self._end(LoadTrust.EXPLAINED)
            else:
                self._start_probe(output, time_s)
        elif self.trust is LoadTrust.JUDGED:
            self._probe(output, time_s)

    def _start_probe(self, output: Output, time_s: float) -> None:
        self.trust, self._mark = LoadTrust.JUDGED, self._measured.mark(output)
        self._until_s = time_s + WAIT_S
        self._lever, self._falls = self._apart(output), False

    def _probe(self, output: Output, time_s: float) -> None:
        mark, here = self._mark, self._measured.mark(output)
        if self._measured.quiet():
            self._end(LoadTrust.EXPLAINED)
        elif mark is not None:
            which = 0 if here.sizes[0] > self._bounds[0] else 1
            ways = (here.T.p - mark.T.p, rotation_log(here.T.R @ mark.T.R.T))
            back = -float(ways[which] @ mark.directions[which])
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

    def _apart(self, output: Output) -> float:
        place = self._settings.T_wrist_sensor
        return 0.0 if place is None else float(np.linalg.norm(output.T_wrist_mrf.p - place.p))

    def _end(self, trust: LoadTrust) -> None:
        self.trust, self._mark, self._until_s = trust, None, 0.0
        self._vouched = trust is LoadTrust.EXPLAINED

    def _doubt(self, output: Output) -> None:
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

    def _share(self, output: Output) -> float:
        """Return the part of their gains that the sensor's sources act with."""
        if (
            self.trust is not LoadTrust.JUDGED
            or self._mode is not Mode.ENABLED
            or others_ask(output.twists)
        ):
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
