"""Contact of a tool by the force that is measured: unexplained, ringing, jammed."""

import math
from collections import deque
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from ..commands.commands import Commands
from ..control.bodies.rates import ArmTick
from ..control.mechanism.wrench import LOAD_TIME_S
from ..control.spatial import GRAVITY, NO_TWIST, Array, Pose, dot, product, sizes
from ..control.task.task import FRAMES
from ..events import Events
from ..mode import Mode
from ..stability.judgement import WRENCH_SOURCES
from ..stability.loops import ForceLoop
from .filters import UNKNOWN_LOAD

# --- Contact of a tool by the force that is measured: where its load is not explained, or joints
# lead
#
# A load that is not explained is told from contact by how the force changes. A weight stays as
# it is in World axes, a bias in the sensor's. So no attitude changes the size of either; and
# while the tool turns by little, neither changes much at all. The size alone is blind to
# contact that takes a weight off and adds as much of its own: pushed up by twice what hangs on
# it, or by friction beside, the tool reads as before.

LASTS = 3
"""Contact of the tool must last for so many ticks [1]."""
MARGIN_N = 2.0 * UNKNOWN_LOAD.force
"""A bias turns round as the tool does [N]."""
SETTLED_S = 0.3
"""So long what is measured may change after the load was said to be unexplained [s]."""
MEAN_OF = 4
"""The tool's acceleration is measured as a mean of so many ticks [1]."""
SEEN_WITHIN = 8
"""A command is measured within so many ticks [1]."""
STAYS_S, WITHIN_S = 0.3, 1.0
"""Contact below the threshold may last, or come and go, for so long within this time [s]."""
RELIEVED_S = 0.15
"""So long force control may take to relieve contact before the stop takes over [s]."""
TURNED = 0.2
"""A tool that has turned by more is compared with what is measured there [rad]."""


class _Load(NamedTuple):
    """Force (3,) of the load in World axes [N], and how the tool stood (3, 3)."""

    force: Array
    R: Array


class ToolContact:
    """Detects contact by a change of the force, or of its size, which no attitude changes."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self.touched = self.found = False
        """`touched` is a reason to stop; `found` says that in this tick something touches."""
        self.known_n = self.off_n = self.bound_n = 0.0
        self._lasting = 0
        self._excused_n = self._told_s = 0.0
        self._load: _Load | None = None
        self._moving = False
        self._measured: deque[Array] = deque(maxlen=MEAN_OF + 2)
        self._told: deque[Array] = deque(maxlen=SEEN_WITHIN + 2)

    @property
    def free(self) -> bool:
        """True while nothing touches the tool for all that the sensor says."""
        return self.off_n <= UNKNOWN_LOAD.force + self._excused_n

    def rest(self) -> None:
        """Forget: the load is explained."""
        self.touched = self.found = False
        self._excused_n, self._lasting, self._told_s, self._load = 0.0, 0, 0.0, None
        self._measured.clear()
        self._told.clear()

    def update(
        self, known_n: float, wrench: Array, weight_n: float, output: ArmTick, moving: bool
    ) -> None:
        """Compare a wrench (6,), World axes, with a load [N], of which `weight_n` is told."""
        if known_n != self.known_n:
            self.known_n, self._load = known_n, None
        began, self._moving = moving and not self._moving, moving
        self._place(output)
        self.off_n = self._off(wrench, output.T_world_mrf_measured.R)
        if began:
            self._excused_n = self.off_n
        # An arm whose load was told wrong may still sink as that is noticed.
        settled, self._told_s = self._told_s > SETTLED_S, self._told_s + self._period_s
        keep = min if settled else max
        self._excused_n = keep(self._excused_n, self.off_n)
        self.bound_n = MARGIN_N + UNKNOWN_LOAD.angle * (known_n + weight_n) + self._excused_n
        # What is moved needs a force as well.
        self.bound_n += 1.5 * known_n / -float(GRAVITY[2]) * self._acceleration()
        beyond = self.off_n > self.bound_n
        self._lasting = self._lasting + 1 if beyond else 0
        self.found = self._lasting >= LASTS
        self.touched = moving and (self.found or (self.touched and beyond))

    def _off(self, wrench: Array, R: Array) -> float:
        """Return by how much a wrench (6,), measured with the tool at R (3, 3), is off [N]."""
        size = abs(sizes(wrench)[0] - self.known_n)
        force, load = wrench[:3], self._load
        if load is None:
            self._load = _Load(force, R)
            return size
        turned = math.acos(min(1.0, max(-1.0, 0.5 * (float(np.sum(R * load.R)) - 1.0))))
        change = force - load.force
        # As much of it as the load may be a bias, which turns with the tool.
        change_n = math.sqrt(float(change @ change)) - 2.0 * math.sin(0.5 * turned) * self.known_n
        if turned > TURNED and max(size, change_n) <= UNKNOWN_LOAD.force:
            self._load = _Load(force, R)
        return max(size, change_n)

    def _place(self, output: ArmTick) -> None:
        """Take in where the tool is, and was told to be."""
        self._measured.append(output.T_world_mrf_measured.p)
        self._told.append(output.T_world_mrf.p)

    def _acceleration(self) -> float:
        """Return what the tool accelerates by, or was told to lately [m/s²].

        As a mean of some ticks: where it chatters on something, each is the contact's own.
        """
        if len(self._measured) < MEAN_OF + 2:
            return 0.0
        steps = np.diff(np.array(self._measured), axis=0)
        mean = sizes(np.append(steps[-1] - steps[0], (0.0, 0.0, 0.0)))[0] / (len(steps) - 1)
        told = np.diff(np.array(self._told), n=2, axis=0)
        return max(mean, float(np.sqrt((told**2).sum(axis=1).max()))) / self._period_s**2


class PressedTool(ToolContact):
    """Detects contact beyond the cell's threshold while joints are commanded themselves.

    A jog or a posture leads the joints wherever the tool presses. What it pressed with when that
    began may be a load that nobody told of, or contact that the joints lead out of: it counts by
    how much more there is than the least since then. So does contact that is lighter and stays, or
    comes and goes, where the joints lead into it more slowly than force control relieves it.
    """

    def __init__(self, threshold_n: float, period_s: float) -> None:
        super().__init__(period_s)
        self._threshold_n = threshold_n
        self._met_s: float | None = None
        self._stays: deque[bool] = deque(maxlen=round(WITHIN_S / period_s))
        """Of the last ticks: whether there was contact."""
        self._most_of = round(STAYS_S / period_s)
        self.watching = False
        """Joints are commanded themselves, or the arm has stopped since."""

    @property
    def free(self) -> bool:
        """True while the tool presses with no more than it did at the least, and did not lately.

        A mean over taps is a load to nobody: the arm would follow what it lacks back into contact.
        """
        return self.off_n <= UNKNOWN_LOAD.force and not any(self._stays)

    def rest(self) -> None:
        """Forget: the sources lead the arm."""
        super().rest()
        self.watching, self._met_s = False, None
        self._stays.clear()

    def follow(self, output: ArmTick | None, by_joint: bool, mode: Mode) -> None:
        """Take in the tick before; `by_joint` says that the joints are commanded themselves."""
        moving = mode is Mode.ENABLED
        lost = output is None or output.wrench is None
        if lost or not mode.energised or (moving and not by_joint):
            if self.watching:
                self.rest()
            return
        if output is None or output.wrench is None or not (by_joint or self.watching):
            return
        force_n = sizes(output.wrench)[0]
        if not self.watching:
            self.watching, self.known_n = True, force_n
        self.known_n = min(self.known_n, force_n)
        self._place(output)
        self.off_n = force_n - self.known_n
        most = (1.0 + UNKNOWN_LOAD.angle) * self.known_n + MARGIN_N
        # What is moved needs a force as well.
        most += 1.5 * self.known_n / -float(GRAVITY[2]) * self._acceleration()
        self.bound_n = max(self._threshold_n, most) - self.known_n
        beyond = self.off_n > self.bound_n
        self._lasting = self._lasting + 1 if beyond else 0
        self._stays.append(force_n > most)
        if self._met_s is not None:
            self._met_s += self._period_s
        elif self._lasting >= LASTS or sum(self._stays) > self._most_of:
            self._met_s = 0.0
        # Force control relieves the contact meanwhile, as quickly as a stop would be, and further.
        relieving = beyond and bool(output.twists["force"].any())
        self.found = self._met_s is not None and not (relieving and self._met_s < RELIEVED_S)
        self.touched = moving and self.found


# --- Contact that rings: force control on something stiffer than the cell declares ----------------
#
# The loop's gain is K_F k_e T, and of these the arm does not know k_e. Beyond the bound the
# force swings at the loop's own frequency: half a swing lasts 2d + 1 periods at the bound
# (`server/stability/loops.py`), and less beyond it; the tool leaves the wall, and comes
# back as hard as before. So the turning points of the force tell: swings in a row, each no
# longer than that, none much smaller than the one before; or the first touch, where the loop's
# gain is far beyond its bound and the tool is thrown off. How much the force changed for the
# tool's way is the stiffness.
#
# Then the whole sum of the task's sources is scaled, force control with all that it balances:
# the loop's gain falls, and what a stick presses with, K_HC u / K_F, stays as it is. A goal is
# dropped: its force would grow with the way that is left. The share stays until an operator
# sets the gains of force control, or the arm is enabled anew; away from the contact, once
# nothing was touched for a while, the arm is as quick as ever.

LONGEST_SWING = 1.5
"""A swing lasts at most so many times half a period of the loop at its bound [1]."""
KEPT = 0.7
"""A swing of a loop that rings has at least that part of the one before [1]."""
LEAST = 0.7
"""Swings of less than that part of what is hard do not count: a peg rattles in its hole [1]."""
DEEP = 0.6
"""A loop that rings swings by that part of its peaks, for it grows until contact is lost [1]."""
SWUNG_BACK = 0.3
"""A swing is over when the force has come back by that part of the one before [1]."""
CONTACT_N = 2.0
"""The stiffness is estimated from greater forces [N]."""
FREE_N = 5.0
"""Less along what rang is none: a tool that accelerates feels some, too [N]."""
SWINGS = 3
"""So many swings in a row are ringing [1]."""
RINGS = 0.75
"""If the loop's gain has that part of its bound; below, something shakes the tool [1]."""
SURELY = 2.0
"""Beyond that part, one touch that throws the tool off is [1]."""
LULLS = 2.5
"""The tool comes back within so many of a swing's longest time [1]."""
SAFE = 0.4
"""The loop's gain is lowered to that part of its bound [1]."""
AT_MOST = 0.5
"""And to this part of what it was, if that is less [1]."""
SMALLEST = 0.002
"""The smallest share [1]."""
FREE_S = 0.5
"""So long after the last contact the tool counts as free [s]."""
AWAY = 0.5
"""A motion leads away from the contact if that part of it does [1]."""
RAMPED_S = 5.0 * LOAD_TIME_S
"""A load or bias that is told anew is in effect after that time [s]."""
RISE = 0.05
"""The share rises again by at most so much in a tick [1]."""
SEEN = 60
"""The stiffness is estimated over so many ticks at most [1]."""


class ContactStability:
    """Notices that one arm's force control rings, and scales the task's motion down."""

    def __init__(
        self,
        loop: ForceLoop | None,
        commands: Commands,
        hard_n: float,
        period_s: float,
        events: Events,
    ) -> None:
        """Build it; without a `loop` it is idle. Beyond `hard_n` a touch is a hard one [N]."""
        self._commands, self._period_s, self._events = commands, period_s, events
        self._hard_n, self._least_n = hard_n, LEAST * hard_n
        self._gain = commands.settings.gains["force"]
        axes = [] if loop is None else [a for a in loop.axes(self._gain) if a is not None]
        self._idle = not axes
        self._bound = min((axis.bound for axis in axes), default=0.0)
        delay = max((axis.delay_periods for axis in axes), default=0.0)
        self._longest = math.ceil(LONGEST_SWING * (2.0 * delay + 1.0))
        self.share = 1.0
        """Part of the task's motion towards what rang [1]."""
        self._told, self._wait_s = commands.settings.load_told, 0.0
        self._acting = 1.0
        self._normal = np.zeros(3)
        """Into what rang, in World (3,)."""
        self._free_s = math.inf
        self._forces: deque[Array] = deque(maxlen=SEEN)
        self._places: deque[Array] = deque(maxlen=SEEN)
        self._forget()

    def _forget(self) -> None:
        self._rising, self._began, self._extreme = True, 0.0, 0.0
        self._since = 0
        """Ticks since the swing began."""
        self._swings: list[float] = []
        """Sizes of quick swings in a row, the newest last [N]."""
        self._forces.clear()
        self._places.clear()

    def update(self, output: ArmTick | None, mode: Mode) -> float:
        """Take in the tick before; return the share of the task's sum that is to act now [1]."""
        settings = self._commands.settings
        if self._idle or output is None:
            return 1.0
        if mode is Mode.READY or settings.gains["force"] is not self._gain:
            self._gain, self.share = settings.gains["force"], 1.0
        if settings.load_told != self._told or settings.sensor_share < 1.0:
            # A reading that is taken otherwise is no contact; a touch under way is forgotten.
            self._told = settings.load_told
            self._wait_s = RAMPED_S
        self._wait_s -= self._period_s
        if not (mode.energised and settings.on["force"]) or self._wait_s > 0.0:
            self._forget()
            self._acting = self.share if settings.on["force"] else 1.0
            return self._acting
        if output.wrench is not None:
            force = product(output.T_world_mrf_measured.R, output.wrench[:3])
            size = math.sqrt(dot(force, force))
            touching = dot(force, self._normal) > FREE_N
            self._free_s = 0.0 if touching else self._free_s + self._period_s
            self._forces.append(force)
            self._places.append(output.T_world_mrf_measured.p)
            if self._swings_on(size):
                self._judge(output)
        aim = self.share if self.share == 1.0 else self._aim(output)
        self._acting = min(aim, self._acting + RISE)
        return self._acting

    def _swings_on(self, size: float) -> bool:
        """Follow the force's size [N]; return whether two swings in a row or more are quick."""
        self._since += 1
        last = self._swings[-1] if self._swings else 0.0
        if (size >= self._extreme) is self._rising:
            self._extreme = size
        elif abs(size - self._extreme) > max(0.5 * self._least_n, SWUNG_BACK * last):
            swing = abs(self._extreme - self._began)
            peak = max(self._extreme, self._began)
            lasts = swing >= max(self._least_n, KEPT * last, DEEP * peak) and self._quick()
            if self._since > LULLS * self._longest:
                self._swings = []
            self._swings = [*self._swings[-3:], swing] if lasts else []
            self._began, self._extreme, self._rising = self._extreme, size, not self._rising
            self._since = 0
        ongoing, peak = abs(self._extreme - self._began), max(self._extreme, self._began)
        return bool(self._swings) and ongoing >= max(KEPT * self._swings[-1], DEEP * peak)

    def _quick(self) -> bool:
        """Return whether the force went from the swing's beginning to its extreme in time."""
        low, high = sorted((self._began, self._extreme))
        edge = 0.1 * (high - low)
        newest = np.array([*self._forces][-(self._since + 1) :])
        sizes = np.sqrt((newest**2).sum(axis=1))
        return int(((sizes > low + edge) & (sizes < high - edge)).sum()) <= self._longest

    def _judge(self, output: ArmTick) -> None:
        """Estimate the stiffness of what is touched, and lower the loop's gain if that rings.

        Where it is far beyond the bound, a hard touch and the swing off are enough, else it takes
        a third.
        """
        thrown = not self._rising and self._swings[-1] > self._hard_n
        few = len(self._swings) < SWINGS - 1
        if few and not thrown:
            return
        stiffness, normal = self._estimated()
        gain = np.asarray(output.task.gains["force"])[:3]
        along = output.T_world_mrf_measured.R.T @ normal
        loop = float(gain @ along**2) * self.share * stiffness * self._period_s
        if loop < (SURELY if few else RINGS) * self._bound:
            return
        self.share = max(SMALLEST, self.share * min(AT_MOST, SAFE * self._bound / loop))
        swing_n, self._normal, self._free_s = self._swings[-1], normal, 0.0
        self._forget()
        goals = self._commands.goals
        if goals.goal is not None:
            goals.drop()
            self._commands.dropped.append(("goal", "contact_unstable"))
        self._events.warning(
            "contact_unstable",
            f"force control rings on {stiffness / 1e3:.3g} kN/m: all that leads the tool acts at "
            f"{100.0 * self.share:.2g} % until its gains are set, or the arm is enabled anew",
            stiffness=stiffness,
            share=self.share,
            swing_n=swing_n,
        )

    def _estimated(self) -> tuple[float, Array]:
        """Return stiffness [N/m] and normal (3,) of the contact over the last ticks."""
        forces, places = np.array(self._forces), np.array(self._places)
        pressed = forces.sum(axis=0)
        normal = pressed / max(math.sqrt(float(pressed @ pressed)), 1e-9)
        f, x = forces @ normal, places @ normal
        touching = (f[1:] > CONTACT_N) & (f[:-1] > CONTACT_N)
        way = float(np.abs(np.diff(x))[touching].sum())
        return float(np.abs(np.diff(f))[touching].sum()) / max(way, 1e-9), normal

    def _aim(self, output: ArmTick) -> float:
        """Return the share to act now: all of it away from the contact, once nothing is touched.

        The normal is known as well as the touch was straight: what leads along leads nowhere away.
        """
        if self._free_s < FREE_S:
            return self.share
        twists = output.twists
        others = sum((t[:3] for name, t in twists.items() if name != "force"), np.zeros(3))
        away = -float(others @ self._normal)
        return 1.0 if away > AWAY * math.sqrt(float(others @ others)) else self.share


# --- Jam monitor: tells when the tool, or a payload, is pressed on without getting any further ----
#
# Rate and force together press with what is asked of the motion over the gain, for ever: on an
# edge beside a hole as well as in it. Every `SAMPLE_S` it is looked at what the sources ask of
# the tool, what it presses with, and where it is; over a window of `JAMMED_S` these tell a
# motion that is held up by contact from one that goes on, however slowly it was asked for.
#
# A plain wall is pressed on by the same means, and because an operator means to: it answers
# straight against the push, through the MRF. That is told quietly, `held_up`. A peg on a rim or
# askew in its hole is pressed beside its axis, or from the side: `jammed`, and so is a
# payload's every stop. A payload that turns about one of its ends gets on at the MRF, but stops
# there: each grasp is looked at, by how it was asked to go. What a link meets the sensor does not
# see, and joints without `[touch]` do not feel: some stay on their leash, and are named.

SAMPLE_S = 0.1
"""It is looked so often [s]."""
JAMMED_S = 2.0
"""Force without progress for so long is a jam [s]."""
SLOWEST = 5e-4
"""Whatever is asked for less, as by a stick at rest, is no motion [m/s]."""
HELD_UP = 0.1
"""Less of what was asked for than this part is no progress [1]."""
PRESSED_N = 5.0
"""Below this against the motion something else holds it up, as a limit does [N]."""
BESIDE = 2e-3
"""A push whose line passes the MRF by more than this is one on an edge [m]."""
TILTS = 0.03
"""If its moment is more than this: the sensor's payload is known no better [N·m]."""
ASIDE = 0.3
"""And so is one that is answered from the side by more than that part of it [1]."""
LEASH = "leash:"
"""Begin of a limit's name, before the joint that is too far behind its command."""


_NOWHERE: Final = np.zeros((0, 3))


class _Sample(NamedTuple):
    """One look."""

    row: Array
    """Velocity and angular velocity that are asked for, force and moment at the MRF that are
    exerted (4, 3), in World axes [m/s, rad/s, N, N·m]."""
    T: Pose
    """Where the MRF was measured."""
    behind: frozenset[str]
    """Joints that the leash holds."""


class _Progress(NamedTuple):
    """How far one place of what is moved got over the window [m]."""

    way: float
    asked: float

    @property
    def left(self) -> float:
        """What it lacks to progress; negative for one that goes on."""
        return HELD_UP * self.asked - self.way


class JamMonitor:
    """Tells a jam once, and again only after progress or another motion."""

    def __init__(self, period_s: float, events: Events, grasps: Array = _NOWHERE) -> None:
        """Build it for a tool, or for a payload with grasps (k, 3) in the axes of its MRF [m]."""
        self._events, self._grasps = events, grasps
        self._every = max(1, round(SAMPLE_S / period_s))
        self._ticks = 0
        self._seen: deque[_Sample] = deque(maxlen=1 + round(JAMMED_S / SAMPLE_S))
        self.jammed = False
        """True while an edge, or anything a payload meets, holds the motion up."""
        self._held = False

    def update(self, output: ArmTick | None) -> None:
        """Take in a tick; None: nothing is known. Without a reading no force is."""
        self._ticks += 1
        if self._ticks % self._every:
            return
        if output is None:
            self._forget()
            return
        asked = np.zeros(6)
        for name, twist in output.twists.items():
            if name not in WRENCH_SOURCES and name != FRAMES:
                asked += twist
        if _size(asked[:3]) < SLOWEST:
            self._forget()
            return
        T, wrench = output.T_world_mrf_measured, output.wrench
        exerted = (NO_TWIST if wrench is None else wrench).reshape(2, 3) @ T.R.T
        behind = frozenset(x[len(LEASH) :] for x in output.limits if x.startswith(LEASH))
        self._seen.append(_Sample(np.concatenate((asked.reshape(2, 3), exerted)), T, behind))
        if len(self._seen) == self._seen.maxlen:
            self._judge()

    def _judge(self) -> None:
        seen = tuple(self._seen)
        rows = np.array([sample.row for sample in seen])
        asked, turning, force, moment = rows.mean(axis=0)
        speed = _size(asked)
        if speed < SLOWEST:
            # There and back, as in a search.
            self.jammed = self._held = False
            return
        along = asked / speed
        places = self._progress(seen[0].T, seen[-1].T, asked, turning, along)
        way, asked_m = least = max(places, key=lambda place: place.left)
        pressed = float((rows[:, 2] @ along).min())
        stuck, pushed = least.left > 0.0, pressed > PRESSED_N
        unseen: frozenset[str] = frozenset()
        if not pushed:
            unseen = seen[0].behind.intersection(*(sample.behind for sample in seen))
        held = stuck and (pushed or bool(unseen))
        on_edge = pushed and (len(self._grasps) > 0 or _on_edge(force, moment, along))
        jammed = stuck and on_edge
        if (jammed and not self.jammed) or (held and not self._held):
            push = float(force @ along)
            what = f"pressed with {push:.1f} N"
            if unseen:
                what = f"held up, with {', '.join(sorted(unseen))} far behind the command,"
            (self._events.warning if jammed or unseen else self._events.info)(
                "jammed" if jammed else "held_up",
                f"{what} for {JAMMED_S:g} s and got {1e3 * way:.1f} mm further "
                f"of {1e3 * asked_m:.1f} that were asked for",
                force_n=push,
                way_m=way,
                asked_m=asked_m,
            )
        # The sensor's noise takes nothing back that was told.
        self.jammed, self._held = held and (jammed or self.jammed), held

    def _progress(
        self, before: Pose, now: Pose, asked: Array, turning: Array, along: Array
    ) -> Iterator[_Progress]:
        """Yield how far the MRF and each grasp got `along` from one pose to another."""
        for place in (np.zeros(3), *self._grasps):
            arm = before.R @ place
            speed = float((asked + np.cross(turning, arm)) @ along)
            if speed >= SLOWEST:
                way = now.p + now.R @ place - before.p - arm
                yield _Progress(float(way @ along), speed * JAMMED_S)

    def _forget(self) -> None:
        self._seen.clear()
        self.jammed = self._held = False


def _on_edge(force: Array, moment: Array, along: Array) -> bool:
    """Return whether a mean wrench at the MRF is none of a push `along` on a plain wall."""
    push, across = float(force @ along), np.cross(force, moment) / _size(force)
    aside = _size(force - push * along) > ASIDE * push
    return aside or _size(across) > max(TILTS, BESIDE * _size(force))


def _size(vector: Array) -> float:
    return math.sqrt(float(vector @ vector))
