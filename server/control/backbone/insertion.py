"""A hyper-redundant arm in its tunnels: how far it is in, and the joint rates that take it on."""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Self

import numpy as np

from ....config.errors import ConfigError
from ....config.load import Cell
from ....config.schema.mechanism import BackboneSection
from ..bodies.body import Builder, SerialArm
from ..bodies.rates import ArmTick, Following, Insertion, JointRates
from ..compiled import NUMBER, TABLE, VECTOR, compiled, evolve
from ..inputs import DriveRequest, Intent, Settings, ToldTunnel
from ..mechanism.model import Mechanism
from ..mechanism.redundancy import Field, Redundancy
from ..parameters import Parameters
from ..scene import Flags
from ..spatial import Array
from ..stop.limiter import StopConstraint
from ..stop.profile import Stop
from .curve import Curve, curve_of, told_section
from .fit import Chain, farthest_apart
from .tunnels import Parts, completed, links_off_centre

# --- A hyper-redundant arm in its tunnels: how far it is in, and the joint rates that take it on
#
# The free length s1 goes with the joints, as they were allowed to move: it is where the
# commanded posture is along the curve's family of fits. So limits slow an insertion without
# bending it, and nothing winds up. Joint rates are the fit's own along s1, and feedback towards
# the fit of now:
#
#     dq = ∂q/∂s1 ds1 + 5 (fit(s1) − q)
#
# Joints beyond the exit are free: an ordinary arm while nothing is inserted or withdrawn.

FEEDBACK = 5.0
"""Gain towards the fit of now [1/s]."""
ENDS = 4.0
"""Approach to the least and the greatest free length [1/s]."""
GRID = 0.005
"""Fits are computed ahead at free lengths that are so much apart [m]."""
FITS = 0.005
"""A posture is the curve's when no point is farther off it [m]."""
LOST = 0.03
"""One that was the curve's is no more beyond this [m]."""
TAIL_OFF = (0.02, 0.07)
"""A tail that is farther off its curve slows an insertion, and holds it up altogether [rad]."""
ARRIVED = 5e-4
"""A depth is reached within this [m]."""
ASIDE = 0.2
"""The head may push aside with this part of `most_push` before an insertion gives way [1]."""
LAGGING = (0.65, 0.9)
"""Measured links that take so much of their room slow what leads them on, and hold it up [1]."""
STOOD, ASKED, STANDS_S = 1.5e-3, 5e-3, 0.03
"""A joint is locked that moved by less than the first [rad], while its command moved by the second
and is as far from it [rad], for the third [s].

One that follows is at most 2 mrad behind, so one that turns round stands, but is near its command.
A drive that missed one setpoint stands for a period."""
ROUND_LOCKED = 3
"""Steps of the fit with locked joints, a tick [1]."""
INSIDE = 25.0
"""Weight of points inside, over those outside, where joints are locked [1]."""
NEAR_FOOT = 1.01
"""Least free length with a feed that is locked, in ways to the entrance from there [1]."""
SLOPE_BY = 0.002
"""Half the way over which such a fit's slope is taken [m]."""
WINDOW = 1.5
"""A point is looked for in the tunnel this many half widths from where it should be [1]."""


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, NUMBER, TABLE)
def _watch(
    q: Array, measured: Array, q_before: Array, measured_before: Array, stood_before: Array,
    period_s: float, out: Array,
) -> bool:  # fmt: skip
    """Write the first three of `Following` (3, n), and return whether they are others than before.

    Joints are commanded at q (n,) and `measured` (n,) [rad]; the others are those before.
    """
    news = False
    for j in range(len(q)):
        moved = abs(measured[j] - measured_before[j]) > STOOD
        asked = min(abs(q[j] - q_before[j]), abs(q[j] - measured[j])) > ASKED
        out[0, j] = q[j] if moved else q_before[j]
        out[1, j] = measured[j] if moved else measured_before[j]
        out[2, j] = stood_before[j] + period_s if asked and not moved else 0.0
        news = news or moved or out[2, j] != 0.0 or stood_before[j] != 0.0
    return news


class Backbone:
    """The curve of one arm, and how its joints follow."""

    def __init__(self, cell: Cell, section: BackboneSection, chain: Chain, curve: Curve) -> None:
        """Build that of a cell's mechanism; `fitting` is to follow."""
        self.chain, self.curve, self.section = chain, curve, section
        self._period_s = cell.config.timing.period_s
        self._where = f"{cell.path}: mechanism.backbone"
        self.exit = sum(piece.length for piece in section.tunnel if not piece.open)
        """Depth of the exit [m]."""
        self._upto = np.array([int(np.abs(curve.arcs.starts - self.exit).argmin())])
        self._stations = np.concatenate((np.minimum(0.0, chain.stations[:1]), chain.stations))
        self._origins = self._stations[:-1]
        self._levers = (chain.length - self._origins) ** 2
        self._levers[: chain.foot] = 1.0
        self._last = int(np.flatnonzero(chain.links.counts)[-1])
        # Scratch: the joints that were looked at last, and their points.
        self._placed: tuple[Array, Array] | None = None
        self.most = chain.length
        count = max(2, round((self.most - section.least) / GRID))
        self.lengths = np.linspace(section.least, self.most, count + 1)
        """Free lengths (g,) at which fits were computed ahead [m]."""
        self.fits, self.slopes = np.empty((2, count + 1, chain.n))
        """Joints (g, n) [rad] at these, and ∂q/∂s1 (g, n)."""
        self._off_centre = np.empty(count + 1)

    @classmethod
    def from_cell(cls, cell: Cell) -> Self | None:
        """Build that of a cell's mechanism, None where it is a plain arm. Raises `ConfigError`."""
        section = cell.config.mechanism.backbone
        return None if section is None else cls.of(cell, section)

    @classmethod
    def of(cls, cell: Cell, section: BackboneSection) -> Self:
        """Build that of a cell's mechanism in some tunnel. Raises `ConfigError`."""
        backbone = completed(cls.laying(cell, section, Chain.from_cell(cell)))
        for _ in backbone.fitting():
            pass
        return backbone

    @classmethod
    def laying(cls, cell: Cell, section: BackboneSection, chain: Chain) -> Parts[Self]:
        """Lay its curve in some tunnel; `fitting` is to follow. Raises `ConfigError`."""
        curve = yield from curve_of(cell, section, chain)
        return cls(cell, section, chain, curve)

    def fitting(self, q: Array | None = None) -> Iterator[None]:
        """Fit the joints at one free length after the other, from the greatest on.

        The first from joints q (n,) by, where such are known: a guess takes some milliseconds.
        Raises `ConfigError` for what no joints of this chain follow.
        """
        for i in reversed(range(len(self.lengths))):
            s1 = float(self.lengths[i])
            try:
                sampled = self.curve.at(s1, self.chain.stations)
                q = self.chain.guess(sampled.points) if q is None else q
                q = self.chain.settled(q, *sampled).q
            except ValueError as error:
                words = f"{self._where}.tunnel: free length {s1:.3f} m: {error}"
                raise ConfigError(words) from None
            self.fits[i] = q
            self._off_centre[i] = self.off_centre(self.chain.points(q[None]), s1)
            yield
        self.slopes[:] = np.gradient(self.fits, self.lengths, axis=0)

    def turns(self, low: Array, high: Array) -> tuple[float, int, int]:
        """Return the greatest share of its range (n,) [rad] that any joint takes, 1 for all of it.

        With the free length and the joint, by their places in `fits`.
        """
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        used = np.abs(self.fits - middle) / half
        i, j = (int(x) for x in np.unravel_index(int(used.argmax()), used.shape))
        return float(used[i, j]), i, j

    def require_passable(self, low: Array, high: Array, names: Sequence[str]) -> None:
        """Raise `ValueError` where joints leave their range (n,) [rad], or links near a wall."""
        used, i, j = self.turns(low, high)
        if used > 1.0:
            raise ValueError(
                f"{names[j]} would be at {self.fits[i, j]:.3f} rad with the tip "
                f"{self.depth_at(i):.3f} m inside: its range is {low[j]:.3f} to {high[j]:.3f}"
            )
        off, i = self.farthest_off()
        if off > self.room:
            raise ValueError(
                f"links would be {off:.4f} m off the centre line with the tip "
                f"{self.depth_at(i):.3f} m inside: at most {self.room:.4f} m"
            )

    def farthest_off(self) -> tuple[float, int]:
        """Return how far links of the fits are off the centre line at most [m], and of which."""
        i = int(self._off_centre.argmax())
        return float(self._off_centre[i]), i

    # --- where the arm is ----------------------------------------------------------------------

    def fitted(self, s1: float, near: Array, locked: Array | None = None) -> tuple[Array, Array]:
        """Return the joints (n,) that follow the curve of a free length [m], and ∂q/∂s1 (n,).

        One step from joints `near` by. The slope is that of the fits computed ahead: the step's own
        leaves out what the curve's bend does to the distances that remain. Where joints are
        `locked` at angles (n,), the others bend around them.
        """
        if locked is not None:
            return self._round_locked(s1, near, locked)
        found = self.chain.fitted(near, *self.curve.at(s1, self.chain.stations), 1)
        place = (s1 - self.lengths[0]) / (self.lengths[1] - self.lengths[0])
        i = min(len(self.lengths) - 2, max(0, int(place)))
        part = place - i
        return found.q, (1.0 - part) * self.slopes[i] + part * self.slopes[i + 1]

    def _round_locked(self, s1: float, near: Array, locked: Array) -> tuple[Array, Array]:
        free = np.isnan(locked)
        least = max(self.section.least, s1 - SLOPE_BY)
        most = min(self.most, s1 + SLOPE_BY)
        q = self._bent(s1, np.where(free, near, locked), free)
        slope = (self._bent(most, q, free) - self._bent(least, q, free)) / (most - least)
        return q, slope

    def _bent(self, s1: float, near: Array, free: Flags) -> Array:
        """Return joints (n,) that follow the curve as well as those that are `free` can."""
        stations, curve, foot = self.chain.stations, self.curve, self.chain.foot
        if not free[:foot].all():
            curve = curve.from_foot(self._points(near)[foot])
            s1 = max(s1, NEAR_FOOT * curve.exterior.chord.h)
        # Where walls are, the arm has least room to be off.
        weights = np.where(stations > s1, INSIDE, 1.0)
        sampled = curve.at(s1, stations)
        return self.chain.fitted(near, *sampled, ROUND_LOCKED, weights, free).q

    def watched(self, before: Following | None, q: Array, measured: Array) -> Following:
        """Return which joints follow, that were commanded at q (n,) and measured (n,) [rad]."""
        if before is None:
            return Following(q, measured, np.zeros(len(q)))
        found, locked, n = np.empty((3, len(q))), before.locked, len(q)
        if not _watch(q, measured, *before[:3], self._period_s, found):
            return before
        locks = found[2] > STANDS_S - 0.5 * self._period_s
        if locks.any():
            at = np.full(n, np.nan) if locked is None else locked
            locked = np.where(locks & np.isnan(at), measured, at)
        return Following(found[0], found[1], found[2], locked)

    def beyond(self, s1: float) -> int:
        """Return the first joint that is beyond the exit at a free length [m]; n for none."""
        clear = s1 + self.exit + self.section.link_radius
        return int(self._origins.searchsorted(clear, side="right"))

    def located(self, q: Array) -> Insertion | None:
        """Return where joints q (n,) are along the curve; None where they do not follow it."""
        off = np.abs(self.fits - q)
        inside = self._origins <= (self.lengths + self.exit + self.section.link_radius)[:, None]
        i = int(np.where(inside, off, 0.0).max(axis=1).argmin())
        s1, fit, slope = float(self.lengths[i]), self.fits[i], self.slopes[i]
        for _ in range(3):
            found = Insertion(s1, fit, slope, 0.0, self.beyond(s1))
            s1 = self._along(found, q)
            fit, slope = self.fitted(s1, fit + slope * (s1 - found.s1))
        found = Insertion(s1, fit, slope, 0.0, self.beyond(s1))
        return found if self._off(found, q) < FITS else None

    def followed(
        self,
        insertion: Insertion | None,
        q: Array,
        following: tuple[Array, Array] | None = None,
    ) -> Insertion | None:
        """Return where joints q (n,) have come to; None once they left the curve.

        `following` are the joints (n,) as commanded and as measured at one instant [rad].
        """
        if insertion is None:
            return self.located(q)
        s1, locked = self._along(insertion, q), insertion.locked
        _, fit, slope, speed, beyond, watched = insertion
        if s1 != insertion.s1 or locked is not None:
            fit, slope = self.fitted(s1, fit + slope * (s1 - insertion.s1), locked)
            beyond = self.beyond(s1)
        if following is not None:
            watched = self.watched(watched, *following)
        insertion = Insertion(s1, fit, slope, speed, beyond, watched)
        return insertion if self._off(insertion, q) < LOST else None

    def _along(self, insertion: Insertion, q: Array) -> float:
        """Return the free length nearest to joints q (n,), by the fit's slope of now."""
        last = insertion.beyond
        slope = insertion.rates[:last]
        by = float(slope @ (q[:last] - insertion.q[:last])) / float(slope @ slope)
        s1 = insertion.s1 + min(GRID, max(-GRID, by))
        return min(self.most, max(self.section.least, s1))

    def _off(self, insertion: Insertion, q: Array) -> float:
        """Return how far the farthest point that is not free is from where the fit has it [m]."""
        (fit,) = self.chain.points(insertion.q[None])
        return farthest_apart(self._points(q), fit, insertion.beyond + 1)

    def _points(self, q: Array) -> Array:
        """Return all points (n + 1, 3) in World at joints q (n,), those of the last ones again."""
        if self._placed is None or self._placed[0] is not q:
            self._placed = q, self.chain.points(q[None])[0]
        return self._placed[1]

    # --- where it is to go ---------------------------------------------------------------------

    def ramped(self, insertion: Insertion, drive: DriveRequest, factor: float) -> Insertion:
        """Return the insertion with the operator's speed one period later; `factor` scales it."""
        bound, speed = self.section.acceleration * self._period_s, drive.speed
        if drive.depth is not None:
            way = ENDS * (drive.depth - self.depth(insertion))
            speed = max(-speed, min(speed, way))
        back_only = drive.back_only or insertion.locked is not None
        most = 0.0 if back_only else self.section.speed
        speed = factor * max(-self.section.speed, min(most, speed))
        step = min(bound, max(-bound, speed - insertion.speed))
        speed = insertion.speed + step
        return insertion._replace(speed=speed)

    def gives_way(self, speed: float, push: Array, head: Array) -> float:
        """Return what share (0 to 1) of an insertion's speed is left, with the head pushing [N].

        `push` (3,) is what it pushes with and `head` (3,) its direction, in World. Ahead, or back
        where it is withdrawn; ahead it gives way to what it meets aside, too.
        """
        most, along = self.section.most_push, float(push @ head)
        share = 1.0 - (along if speed > 0.0 else -along) / most
        if speed > 0.0:
            aside = math.sqrt(max(0.0, float(push @ push) - along * along))
            share = min(share, (1.0 - aside / most) / (1.0 - ASIDE))
        return min(1.0, max(0.0, share))

    def kept_off(self, insertion: Insertion, q: Array, error: Array, dq: Array) -> float:
        """Return what share (0 to 1) of joint rates dq (n,) keeps links off the walls.

        At joints q (n,) that are `error` (n,) ahead of the measured ones [rad]. A joint that does
        not follow takes what is outboard off the curve; what leads back to it is free.
        """
        if float((self._levers * error) @ dq) <= 0.0:
            return 1.0
        off = self.off_centre(self.chain.points((q - error)[None]), insertion.s1)
        low, high = LAGGING
        return min(1.0, max(0.0, (high - off / self.room) / (high - low)))

    def depth(self, insertion: Insertion) -> float:
        """Return the tip's way from the entrance [m]."""
        return self.chain.length - insertion.s1

    def depth_at(self, fit: int) -> float:
        """Return that of one of the fits [m]."""
        return self.chain.length - float(self.lengths[fit])

    def arrived(self, insertion: Insertion, drive: DriveRequest) -> bool:
        """Return whether the arm is at the depth that it was driven to."""
        return drive.depth is not None and abs(drive.depth - self.depth(insertion)) < ARRIVED

    def rates(self, insertion: Insertion, q: Array, forward: float) -> tuple[Array, float]:
        """Return joint rates (n,) at q (n,) that insert at `forward` [m/s], and what is left of it.

        It ends at the least and the greatest free length, and waits for a tail that is off.
        """
        s1, section = insertion.s1, self.section
        speed = min(section.speed, forward, ENDS * (s1 - section.least))
        speed = max(-section.speed, speed, -ENDS * (self.most - s1))
        error = insertion.q - q
        tail = error[insertion.beyond :]
        if len(tail):
            low, high = TAIL_OFF
            speed *= min(1.0, max(0.0, (high - float(np.abs(tail).max())) / (high - low)))
        return FEEDBACK * error - speed * insertion.rates, speed

    def head(self, q: Array) -> Array:
        """Return the direction of the last link (3,) in World at q (n,)."""
        points = self._points(q)
        way = points[-1] - points[self._last]
        return np.asarray(way / math.sqrt(float(way.dot(way))))

    # --- walls ---------------------------------------------------------------------------------

    def off_centre(self, points: Array, s1: float) -> float:
        """Return how far links are off the tunnel's centre line at most [m].

        Of link ends and middles that are inside, with a free length about s1 [m], of postures whose
        points are (s, n + 1, 3) in World.
        """
        depths, window = self._stations - s1, WINDOW * self.section.half_width
        return links_off_centre(self.curve.arcs[:], points, depths, window, self._upto)

    def beyond_wall(self, insertion: Insertion | None, q: Array) -> float:
        """Return how far links at joints q (n,) stand beyond the walls [m]; 0 for not.

        Off the curve, as at the free length whose fit is nearest.
        """
        if insertion is None:
            s1 = float(self.lengths[int(np.abs(self.fits - q).max(axis=1).argmin())])
        else:
            s1 = insertion.s1
        to_wall = self.section.half_width - self.section.link_radius
        return max(0.0, self.off_centre(self.chain.points(q[None]), s1) - to_wall)

    @property
    def room(self) -> float:
        """How far links may be off the centre line [m]."""
        return self.section.half_width - self.section.link_radius - self.section.clearance


# --- An arm whose joints follow a curve through tunnels: a twist inserts it, or moves its tail ----
#
# Inside, the summed twist acts along the head's tangent, as an insertion speed. Beyond the exit
# an arm of enough free joints answers the whole twist by itself, while the joints inside stand;
# a drive's command inserts or withdraws it as a curve again, and its tail returns to the curve
# first.

STANDS = 1e-6
"""An insertion that is slower stands [m/s]."""
ARRIVED_SPEED = 2e-3
"""At its depth, an arm that is still this fast is not there yet [m/s]."""
SLOWED = 0.99
"""An insertion that gets less than this part of its asked speed is told as slowed [1]."""
LOOK_S = 0.025
"""Stops are looked at so often along the way [s]."""
ALONG, SAME = 400, 1e-4
"""A tunnel stays where it is if so many points of it move by no more [1, m]."""
MOST_PARTS = 350
"""Parts of a search for the curves across gaps that an operator tells [1]: 3.5 s of periods."""
PORTION = 120
"""Joints that are fitted to a told tunnel in one step, of all free lengths together [1]."""
WORSE = 1e-4
"""A stop may be off the tunnel's centre line by so much more than the arm is now [m]."""


class BackboneArm(SerialArm):
    """An arm whose joints follow a curve: a twist inserts it, or moves its tail."""

    on_curve = True

    def __init__(
        self,
        cell: Cell,
        backbone: Backbone,
        p: Parameters,
        mechanism: Mechanism,
        redundancy: Redundancy,
        field: Field,
    ) -> None:
        """Build it; `backbone` is that of the cell's own tunnel."""
        super().__init__(p, mechanism, redundancy, field)
        self._cell, self._joints = cell, p.joints
        self._own, self._told = backbone, dict[ToldTunnel, Backbone]()
        self.backbone = backbone
        """In the tunnel that is in force."""
        self.synchronized = (slice(0, p.joints.n),)
        self.relief[:] = 0.0
        self._names, self._rank = p.joints.names, mechanism.rank

    @classmethod
    def builder(cls, cell: Cell) -> Builder | None:
        """Return what builds it for a cell with a backbone. Raises `ConfigError`."""
        backbone = Backbone.from_cell(cell)
        return None if backbone is None else partial(cls, cell, backbone)

    # --- a tunnel that an operator told --------------------------------------------------------

    def prepare(self, settings: Settings) -> None:
        """Take the tunnel that is in force: one that is told is fitted once, before that."""
        tunnel = settings.tunnel
        self.backbone = self._own if tunnel is None else self._laid(tunnel)

    def refitting(
        self, tunnel: ToldTunnel | None, postures: Callable[[], Sequence[Array]]
    ) -> Iterator[None]:
        """Fit the joints to a tunnel that an operator tells, and judge it: None is the cell's own.

        Each step is a part of a period's work. `postures` returns, at the end, those (n,) that the
        arm is or may come to be in before the tunnel is in force. Raises `ValueError` for one that
        its joints or links cannot pass, and where the part that the arm is in would move.
        """
        if tunnel is not None:
            yield from self._laying(tunnel)
        self._judge(self._own if tunnel is None else self._told[tunnel], postures())

    def _judge(self, new: Backbone, postures: Sequence[Array]) -> None:
        old = self.backbone
        found = [old.located(q) for q in postures]
        depths = [old.depth(insertion) for insertion in found if insertion is not None]
        if not depths or len(depths) < len(found):
            raise ValueError("the arm is off its curve: bring it back to it first")
        new.require_passable(self._joints.lower, self._joints.upper, self._names)
        inside = np.linspace(0.0, max(0.0, *depths), ALONG)
        stands = "is" if depths[0] == max(depths) else "comes to rest"
        apart = np.linalg.norm(new.curve.arcs.at(inside)[0] - old.curve.arcs.at(inside)[0], axis=1)
        if float(apart.max()) > SAME:
            still = inside[int((apart > SAME).argmax()) - 1]
            raise ValueError(
                f"the tip {stands} {inside[-1]:.4f} m inside, where the tunnel would move by "
                f"{apart.max():.4f} m: withdraw it to {still:.4f} m first"
            )
        near, far = sorted((new.exit, old.exit))
        if min(far, inside[-1]) - near > SAME:
            raise ValueError(
                f"the tip {stands} {inside[-1]:.4f} m inside, where walls would end at "
                f"{new.exit:.4f} m, not {old.exit:.4f}: withdraw it to {near:.4f} m first"
            )

    def _laid(self, tunnel: ToldTunnel) -> Backbone:
        """Return the backbone in a tunnel that was told. Raises `ValueError`."""
        for _ in self._laying(tunnel):
            pass
        return self._told[tunnel]

    def _laying(self, tunnel: ToldTunnel) -> Iterator[None]:
        """Lay and fit a tunnel that was told: a step of a gap, or some free lengths, at a time."""
        if tunnel in self._told:
            return
        section = told_section(self._own.section, tunnel)
        try:
            laid = yield from _within(Backbone.laying(self._cell, section, self._own.chain))
            every = max(1, PORTION // laid.chain.n)
            # With the tip in the entrance, the arm is where it is in any tunnel.
            for i, _ in enumerate(laid.fitting(self._own.fits[-1])):
                if i % every == 0:
                    yield
        except ConfigError as error:
            # It names the cell's key; here pieces were told.
            words = str(error).removeprefix(f"{self._cell.path}: mechanism.backbone.")
            raise ValueError(words.replace("tunnel[", "pieces[")) from None
        kept = {old: found for old, found in self._told.items() if found is self.backbone}
        self._told = {**kept, tunnel: laid}

    def rates(self, request: ArmTick) -> JointRates:
        """Return joint rates at the commanded posture.

        An arm with a joint that is locked may withdraw, and nothing else.
        """
        inputs, drive = request.inputs, request.inputs.drive
        (q, *_), _, sent = request.commanded
        if inputs.intent is Intent.SEED:
            return self._along(np.zeros(len(q)), None, ())
        insertion = self.backbone.followed(request.insertion, q, (sent[1], inputs.q_measured))
        if insertion is None:
            return self._along(np.zeros(len(q)), None, ("off_backbone",))
        if request.moving:
            insertion = self.backbone.ramped(insertion, drive, inputs.settings.speed_factor)
        else:
            insertion = insertion._replace(speed=0.0)
        free, locked = len(q) - insertion.beyond, insertion.locked
        back_only = drive.back_only or locked is not None
        driven = abs(insertion.speed) > STANDS or drive.speed != 0.0
        if self.backbone.arrived(insertion, drive):
            driven = abs(insertion.speed) > ARRIVED_SPEED
        if free > self._rank and not driven and not back_only:
            return self._tail(request, insertion)
        head = self.backbone.head(q)
        twist = float(head @ request.asked[:3]) if free <= self._rank else 0.0
        share = 1.0
        if request.wrench is not None:
            push = request.T_world_mrf.R @ request.wrench[:3]
            share = self.backbone.gives_way(insertion.speed, push, head)
        forward, granted = twist + insertion.speed, twist + share * insertion.speed
        if back_only:
            granted = min(0.0, granted)
        dq, speed = self.backbone.rates(insertion, q, granted)
        if not request.spare and abs(speed) < STANDS:
            dq = np.zeros(len(q))
        slowed = abs(speed) < SLOWED * abs(forward) and abs(forward) > STANDS
        limits: tuple[str, ...] = ("insertion_speed",) if slowed else ()
        if locked is not None:
            limits += tuple(f"locked:{self._names[i]}" for i in np.flatnonzero(~np.isnan(locked)))
        return self._along(dq, insertion, limits)

    def _along(self, dq: Array, insertion: Insertion | None, limits: tuple[str, ...]) -> JointRates:
        """Return rates dq (n,) along the curve, where no joint makes up for another."""
        found = self._resolver.none(dq)
        return found._replace(limits=limits, synchronized=True, insertion=insertion)

    def _tail(self, request: ArmTick, insertion: Insertion) -> JointRates:
        """Return the rates of what is beyond the exit; the joints inside stand."""
        k, inside = request.kinematics, insertion.beyond
        J = k.J.copy()
        J[:, :inside] = 0.0
        found = self._resolver.rates(evolve(request, kinematics=k._replace(J=J)))
        dq = found.dq.copy()
        dq[:inside] = 0.0
        return found._replace(dq=dq, insertion=insertion._replace(speed=0.0), n_locked=inside)

    def spare(
        self,
        insertion: Insertion | None,
        ranks: tuple[int, int] | None,  # noqa: ARG002  it holds all axes
    ) -> int:
        """Return how many freedoms are spare beyond the exit, where those joints lead the tool."""
        free = 0 if insertion is None else self.backbone.chain.n - insertion.beyond
        return max(0, free - self._rank)

    def wall_scale(self, tick: ArmTick) -> float:
        """Return the share of rates along the curve that keeps measured links off walls."""
        q, insertion = tick.commanded.motion.q, tick.found.insertion
        if insertion is None or not tick.found.synchronized:
            return 1.0
        return self.backbone.kept_off(insertion, q, tick.error, tick.dq_asked)

    def arrived(self, insertion: Insertion | None, drive: DriveRequest) -> bool | None:
        """Return whether the tip is at the depth that a drive leads it to, if it does."""
        if drive.depth is None:
            return None
        return insertion is not None and self.backbone.arrived(insertion, drive)

    def beyond_wall(self, insertion: Insertion | None, q: Array) -> float:
        """Return how far links at joints q (n,) stand beyond the walls of their tunnel [m]."""
        return self.backbone.beyond_wall(insertion, q)

    def telemetry(self, insertion: Insertion | None) -> dict[str, float] | None:
        """Return where the arm is along its curve; None off it."""
        if insertion is None:
            return None
        return {
            "depth": self.backbone.depth(insertion),
            "speed": insertion.speed,
            "free": float(self.backbone.chain.n - insertion.beyond),
        }

    # --- the promise along a stop --------------------------------------------------------------

    def stop_constraint(self, tick: ArmTick) -> StopConstraint | None:
        """Return what judges stops of an arm that is on its curve."""
        q, insertion = tick.commanded.motion.q, tick.found.insertion
        return None if insertion is None else partial(self.violation, insertion, q, tick.error)

    def violation(self, insertion: Insertion, q: Array, error: Array, stop: Stop) -> float:
        """Return by how much a stop brings links too near to the walls [m]; 0 for not.

        From joints q (n,) that are `error` (n,) ahead of the measured ones [rad].
        """
        times = _looks(stop.to_go_s)
        postures = np.empty((2 + len(times), len(q)))
        postures[0], postures[1], postures[2:] = q, q - error, stop.postures(times)
        backbone, s1 = self.backbone, insertion.s1
        points = backbone.chain.points(postures)
        lag = farthest_apart(points[0], points[1], len(q) + 1)
        bound = max(backbone.room - lag, backbone.off_centre(points[:1], s1) + WORSE)
        return max(0.0, backbone.off_centre(points[2:], s1) - bound)


def _within(work: Parts[Backbone]) -> Parts[Backbone]:
    """Do work in no more than so many parts. Raises `ValueError`."""
    for _ in range(MOST_PARTS):
        try:
            yield next(work)
        except StopIteration as end:
            laid: Backbone = end.value
            return laid
    raise ValueError(
        f"the curves across its gaps are not found in {MOST_PARTS} steps: tell a longer gap, or "
        "one that turns less"
    )


def _looks(to_go_s: float) -> Array:
    """Return the instants (s,) at which a stop is looked at, now and at its end among them [s]."""
    count = max(1, math.ceil(to_go_s / LOOK_S))
    times = np.arange(count + 1, dtype=np.float64) * (to_go_s / count)
    times[-1] = to_go_s
    return times
