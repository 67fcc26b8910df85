"""From telegrams to messages: what `telerobot scan` does, and a simulation in its place.

telegram ──► rays ──► placed ──► own rays bridged ──► memory ──► contour ──► reflex
              ▲ joints, odometry at their instants                  └──► boxes
"""

import math
from collections import deque
from collections.abc import Iterable, Iterator
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from ....config.load import Cell, ConfigError
from ....config.schema.surroundings import ContourReflexSection, ScannerSection
from ....drivers.scanner import Clocks
from ....protocols.messages.perception import NOTHING, ContourNews, ObstacleNews
from ....protocols.messages.telemetry import State
from ....protocols.sick import Scan, TelegramError
from ...control.scene import Flags
from ...control.spatial import Array, Pose
from .contour import (
    MOST,
    CellBox,
    CellPlane,
    Contour,
    Obstacles,
    along_arc,
    boxes_of,
    contour_of,
)
from .contour import NOTHING as NONE
from .placing import (
    FARTHEST,
    GroundBehind,
    MeasuredInstant,
    PointMemory,
    Ring,
    ScannerGeometry,
    bridged,
    instant_of,
    own_rays,
    place,
)
from .reflex import (
    BESIDE,
    CriticalPoints,
    PassageReflex,
    Reach,
    Reaction,
    Search,
    Steering,
    speed_within,
)
from .slip import SlipMonitor

SCAN: Final = "scan"
"""Name under which a scanner tells of obstacles; that of its certificate, too."""

CONTOUR_EVERY: Final = 2
"""Scans from contour to contour [1]; more where several wait: of those only the newest has one."""
BOXES_EVERY: Final = 5
"""Contours from boxes to boxes [1]."""
MISSING_EVERY_S: Final = 5.0
"""Missing rays are told at most so often [s]."""
MOST_MISSING: Final = 0.9
"""A sweep in which more rays had no echo saw nothing: a cover, or dirt [1]."""
BEHIND_REAR: Final = 0.05
"""Obstacles so far behind the arm's rear are passed [m]."""
KEPT_BEHIND: Final = 2.0
"""Distance behind which a passed obstacle is forgotten [m]: an arm that unfolds swings back."""
BOXES_BEHIND: Final = 4
"""Of the boxes that are told, what is passed has at most so many [1]."""
BOX_MOVED: Final = 0.01
"""Boxes are told anew when a side has moved by so much [m]."""
FLOOR: Final = 0.05
"""What is lower is the floor, or rolled over [m]."""
WAITING: Final = 8
"""Scans that wait for telemetry; more mean that there is none [1]."""


class Looked(NamedTuple):
    """Everything that one scan led to, for who tells or draws it."""

    tick: int
    """The newest tick of which telemetry was there."""
    scan: Scan
    points: Array
    """Rays (n, 3) in the odometry's frame, NaN where nothing was hit [m]."""
    own: Flags
    """Rays that hit the arm (n,)."""
    contour: Contour | None = None
    answer: Reaction | None = None
    messages: tuple[ContourNews | ObstacleNews, ...] = ()

    @property
    def points_mm(self) -> bytes:
        """Points that were hit, as `ScanPoints` has them."""
        hit = self.points[~np.isnan(self.points[:, 0])]
        return np.rint(1e3 * hit).astype("<i4").tobytes()


class Scanning:
    """Perception of one cell. Tell it telemetry and scans; it returns messages for the daemon."""

    def __init__(self, cell: Cell) -> None:
        """Build it. Raises `ConfigError` for a cell without scanner or contour."""
        scanner, contour = cell.config.scanner, cell.config.contour
        if scanner is None or contour is None:
            key = "scanner" if scanner is None else "contour"
            raise ConfigError(f"{cell.path}: {key}: missing: there is nothing to scan for")
        self.scanner, self.config = scanner, contour
        self.geometry, self.ring, self.memory = ScannerGeometry(cell), Ring(), PointMemory()
        p = contour.plane
        self.plane = CellPlane(p.width, p.height, p.cell, p.collect)
        points = CriticalPoints(cell, contour.shoulder, contour.elbow, contour.foot)
        self._points, self._foot = points, np.array(contour.foot)
        # What carries the arm, and the scanner, are between floor and foot.
        height = self.plane.cell * math.floor((contour.foot[2] - FLOOR) / self.plane.cell + 1e-9)
        low = max(0.0, height) if contour.base_width else 0.0
        self._below = self.plane._replace(height=low)
        search = Search(points, self.plane, reach_of(contour), contour.base_width, -low)
        self._search, self.steering = search, Steering(contour.steer)
        self.ground = GroundBehind(contour.base_width, contour.base_rear, contour.foot[2])
        """What is known of the ground that the base may be driven back over."""
        sweep = cell.config.mechanism.sweep
        decide_s = 0.0 if sweep is None else 2.0 * sweep.period_s
        self.reflex = PassageReflex(
            search,
            decide_s,
            in_sequence=contour.rule == "sequence",
            wait=contour.wait,
            trigger=contour.plane.ahead,
            silent_s=scanner.silent_s,
        )
        self.slip = SlipMonitor.from_cell(cell)
        """Wheels against scans; None for an arm that does not roll."""
        self.events: deque[str] = deque(maxlen=100)
        """Words about telegrams that were refused, and missing rays, for who prints them."""
        self.scans = self.refused = self.contours = 0
        self._clocks = Clocks()
        self._waiting: deque[tuple[Scan, float]] = deque()
        self._without = 0  # scans since the last contour
        self._told: dict[str, tuple[Array, Array, float]] = {}
        self._silent = 0.0
        """Share of rays without an echo, lately."""
        self._complained_s = -math.inf

    # --- what comes in -----------------------------------------------------------------------

    def listen(self, states: Iterable[State], arrived_s: float) -> Iterator[Looked]:
        """Take in telemetry that arrived by a time of who listens [s], and look as `hear`."""
        instants = []
        for state in states:
            self._clocks.hear_daemon(arrived_s, state.time_s)
            instants.append(instant_of(state, self.geometry.home))
        yield from self.hear(instants)

    def receive(self, found: Scan | TelegramError, arrived_s: float) -> str:
        """Take in what the scanner sent, at a time of who listens [s].

        Return why it is refused; nothing for a scan that is taken, or of a time not known yet.
        """
        try:
            if isinstance(found, TelegramError):
                raise found
            start_s = self._clocks.hear_scanner(arrived_s, found.start_us, found.sent_us)
            if start_s is not None:
                self.take(found, start_s)
        except TelegramError as error:
            self.refused += 1
            return f"telegram refused: {error}"
        return ""

    def hear(self, instants: Iterable[MeasuredInstant]) -> Iterator[Looked]:
        """Take in instants, the oldest first, and look at the scans that they let place.

        At all of them, so that a busy machine forgets nothing, but with a contour for the newest
        alone, so that it does not fall behind.
        """
        for instant in instants:
            self.ring.add(instant)
        placed = list(self._placed())
        for k, (scan, start_s, around) in enumerate(placed, 1):
            yield self._look(scan, start_s, around, newest=k == len(placed))

    def _placed(self) -> Iterator[tuple[Scan, float, list[MeasuredInstant]]]:
        """Yield the scans that telemetry covers, when each began [s], and the instants around."""
        while self._waiting:
            scan, start_s = self._waiting[0]
            instants = self.ring.around(start_s, start_s + self._duration(scan))
            if len(instants) < 2:
                return
            self._waiting.popleft()
            yield scan, start_s, instants

    def take(self, scan: Scan, start_s: float) -> None:
        """Take in a scan whose zero index passed at a time of the daemon's [s].

        Raises `TelegramError` for one of another angle range, or that the scanner calls faulty.
        """
        refusal = unlike(self.scanner, scan)
        if refusal is not None:
            raise TelegramError(refusal)
        if len(self._waiting) >= WAITING:
            self._waiting.popleft()
        self._waiting.append((scan, start_s - self.scanner.late_s))

    def forget(self) -> None:
        """Know nothing: the daemon, or the scanner, started again."""
        self._forget_places()
        self._clocks, self.ring = Clocks(), Ring()
        self._waiting.clear()
        if self.slip is not None:
            self.slip.forget()
            self.slip.slipping = False

    def _forget_places(self) -> None:
        """Know nothing of where things are: the odometry's frame is another one."""
        self.memory.forget()
        self.ground.forget()
        self.reflex.forget()
        self.steering.forget()

    # --- one scan ----------------------------------------------------------------------------

    def _duration(self, scan: Scan) -> float:
        """Return how long the rays of a scan take, from its zero index [s]."""
        turn = scan.step_rad * len(scan.distances) / (2.0 * math.pi)
        return turn / scan.frequency_hz

    def _look(
        self, scan: Scan, start_s: float, instants: list[MeasuredInstant], *, newest: bool
    ) -> Looked:
        self.scans += 1
        self._without += 1
        n = len(scan.distances)
        angle = scan.angles
        turn_s = scan.step_rad / (2.0 * math.pi * scan.frequency_hz)
        time_s = start_s + turn_s * np.arange(n, dtype=np.float64)
        knots = self.geometry.knots(instants)
        raw = place(time_s, angle, scan.distances, knots)
        own = own_rays(time_s, raw, knots, self.geometry.reach)
        distance = bridged(angle, scan.distances, own) if own.any() else scan.distances
        points = place(time_s, angle, distance, knots)
        self._judge_silence(np.isnan(scan.distances), time_s[-1])
        middle = len(instants) // 2
        # Where a ray was the arm's own, nothing can be told of what is behind.
        seen = np.where(own, np.nan, np.where(np.isnan(scan.distances), np.inf, scan.distances))
        self.memory.see_through(
            knots.R[middle], knots.p[middle], scan.first_rad, scan.step_rad, seen
        )
        now, echo = instants[-1], ~np.isnan(scan.distances)
        beyond = np.where(echo, scan.distances, 2.0 * FARTHEST)
        ends = raw if echo.all() else place(time_s, angle, beyond, knots)
        self.ground.see(knots.p[middle], ends, echo, own, now.time_s)
        self.memory.add(points[self._in_reach(points, now)])
        if self.slip is not None:
            self.slip.see(np.where(own[:, None], np.nan, raw), knots.p[middle], now)
        looked = Looked(now.tick, scan, points, own)
        if self._without < CONTOUR_EVERY or not newest:
            return looked
        self._without = 0
        self.contours += 1
        return self._answer(looked, now)

    def _in_reach(self, points: Array, now: MeasuredInstant) -> Flags:
        """Return which points (n,) are ahead, where the contour collects them, or nearly so."""
        seen = (points - now.T_world_base.p) @ now.T_world_base.R - self._foot
        plane = self.plane
        with np.errstate(invalid="ignore"):
            which: Flags = (
                (np.abs(seen[:, 0]) < plane.collect + 0.5)
                & (np.abs(seen[:, 1]) < 0.5 * plane.width + 0.5)
                & (seen[:, 2] > -max(plane.cell, self._below.height))
                & (seen[:, 2] < plane.height + 0.5)
            )
        return which

    def _judge_silence(self, none: Flags, now_s: float) -> None:
        """Tell when nearly all rays have no echo."""
        self._silent += 0.02 * (float(none.mean()) - self._silent)
        if self._silent > MOST_MISSING and now_s - self._complained_s > MISSING_EVERY_S:
            self._complained_s = now_s
            self.events.append(f"rays are missing: {100 * self._silent:.0f} % have no echo")

    # --- contour and reflex ------------------------------------------------------------------

    def _answer(self, looked: Looked, now: MeasuredInstant) -> Looked:
        slide, slipping = None, False
        if self.slip is not None:
            slipped, slide = self.slip.slipping, self.slip.judge()
            slipping = self.slip.slipping
            if slipping is not slipped:
                self._forget_places()
        R, p = now.T_world_base
        foot = p + R @ self._foot
        q = now.q[self._points.arm]
        ahead = self._points.of(q[None])[0, :, 0]
        rear = min(float(ahead.min()), 0.0) - self.config.link_radius - BEHIND_REAR
        self.memory.pass_by(R, foot, min(rear, -KEPT_BEHIND), self.plane.collect + 0.5)
        seen, hits = (self.memory.points - foot) @ R, self.memory.hits
        contour = contour_of(seen, hits, self.plane, rear)
        passed = contour_of(seen, hits, self.plane._replace(collect=rear), -KEPT_BEHIND)
        beside = -self.config.base_rear - float(self._foot[0])
        curvature = self.steering.step(
            now.time_s, now.T_world_base, partial(self._meets, seen, hits, beside)
        )
        front = float(self._foot[0] + ahead.max())
        answer = self.reflex.step(
            now.time_s,
            q,
            self._met(seen, hits, rear, curvature, front, contour),
            Obstacles.behind(passed, self.plane),
        )
        self.ground.stand(now.T_world_base, now.time_s)
        room = self.ground.room(now.T_world_base, now.time_s)
        back = speed_within(room, self.scanner.silent_s)
        news = self._news(now.tick, contour, answer, back)
        update = {"slipping": slipping, "slide": slide, "curvature": curvature}
        news = news.model_copy(update=update)
        messages: list[ContourNews | ObstacleNews] = [news]
        if self.contours % BOXES_EVERY == 0:
            boxes = boxes_of(passed, BOXES_BEHIND)
            boxes += boxes_of(contour, MOST - len(boxes))
            messages += self._boxes(now.tick, boxes, Pose(R, foot))
        return looked._replace(contour=contour, answer=answer, messages=tuple(messages))

    def _met(
        self,
        seen: Array,
        hits: Array,
        rear: float,
        curvature: float,
        front: float,
        straight: Contour | None = None,
    ) -> Obstacles:
        """Return what a base that is driven on an arc meets, with an arm that reaches to `front`.

        `straight` is the contour of points as they are `seen`, where that is known already.
        """
        if curvature == 0.0 and straight is not None:
            return Obstacles.of(straight, self.plane).beside(self._lower(seen, hits, rear))
        along = along_arc(seen, self._foot, curvature)
        upper = Obstacles.of(contour_of(along, hits, self.plane, rear), self.plane)
        lower, nose = self._lower(along, hits, rear), max(self.config.base_rear, self._foot[0])
        # What is ahead of Base, or behind, is on the outer side of the arc.
        for_arm, for_base = (0.5 * curvature * float(x) ** 2 for x in (max(front, nose), nose))
        return upper.wider(max(0.0, -for_arm), max(0.0, for_arm)).beside(
            lower.wider(max(0.0, -for_base), max(0.0, for_base))
        )

    def _meets(self, seen: Array, hits: Array, rear: float, curvature: float) -> bool:
        """Return whether what cannot move meets something on an arc, or is nearly as near to it."""
        met = self._met(seen, hits, rear, curvature, 0.0).within(rear, self.config.plane.ahead)
        return bool(self._search.blocked(met.wider(BESIDE, BESIDE)))

    def _lower(self, seen: Array, hits: Array, rear: float) -> Obstacles:
        """Return what stands lower than the arm's foot, and higher than the floor."""
        if not self._below.height:
            return NONE
        up = np.array([0.0, 0.0, self._below.height])
        strip = contour_of(seen + up, hits, self._below, rear)
        return Obstacles.of(strip, self._below).lifted(-self._below.height)

    def _news(self, tick: int, contour: Contour, answer: Reaction, most_back: float) -> ContourNews:
        rows, columns = self.plane.shape
        millimetres = np.where(
            np.isnan(contour.nearest), NOTHING, np.clip(np.rint(contour.nearest * 1e3), 0, 20_000)
        )
        return ContourNews(
            tick=tick,
            rows=rows,
            columns=columns,
            cell=self.plane.cell,
            nearest_mm=millimetres.astype("<u2").tobytes(),
            phase=answer.phase.value,
            reason=answer.reason,
            posture=None if answer.posture is None else tuple(answer.posture.tolist()),
            most_speed=None if math.isinf(answer.most_speed) else answer.most_speed,
            most_speed_back=most_back,
        )

    def _boxes(self, tick: int, boxes: tuple[CellBox, ...], T: Pose) -> Iterator[ObstacleNews]:
        """Return what is new of the boxes around occupied cells."""
        yaw = math.atan2(T.R[1, 0], T.R[0, 0])
        found: dict[str, tuple[Array, Array, float]] = {}
        for k, box in enumerate(boxes):
            low, high = box.corners(self.plane)
            found[f"scan_{k}"] = T.p + T.R @ (0.5 * (low + high)), 0.5 * (high - low), yaw
        for name in [name for name in self._told if name not in found]:
            yield ObstacleNews(name=name, tick=tick, remove=True)
        for name, (centre, half, turn) in found.items():
            before = self._told.get(name)
            if before is not None and _near(before, (centre, half, turn)):
                found[name] = before
                continue
            x, y, z = centre.tolist()
            a, b, c = half.tolist()
            yield ObstacleNews(
                name=name,
                tick=tick,
                shape="box",
                xyz=(x, y, z),
                rpy=(0.0, 0.0, turn),
                half_size=(a, b, c),
                max_speed=0.0,
            )
        self._told = found


def _near(a: tuple[Array, Array, float], b: tuple[Array, Array, float]) -> bool:
    """Return whether two boxes are the same, as nearly as matters."""
    moved = np.abs(a[0] - b[0]).max() + np.abs(a[1] - b[1]).max()
    return bool(moved < BOX_MOVED) and abs(a[2] - b[2]) * float(a[1].max()) < BOX_MOVED


def reach_of(contour: ContourReflexSection) -> Reach:
    """Return the distances of a cell's contour: beyond the links' radius, noise and hysteresis."""
    r = contour.link_radius
    return Reach(choose=r + 0.05, trigger=r + 0.04, give_up=r + 0.01, column=r + 0.02)


def unlike(scanner: ScannerSection, scan: Scan) -> str | None:
    """Return why a scan is not one of a cell's scanner, or None."""
    if scan.faulty:
        return "the scanner tells that it is faulty"
    for name, value, wanted, slack in (
        ("first angle", scan.first_rad, scanner.first, 1e-3),
        ("angular step", scan.step_rad, scanner.step, 1e-5),
        ("rays", len(scan.distances), scanner.rays, 0),
        ("frequency", scan.frequency_hz, scanner.rate_hz, 0.5),
    ):
        if abs(value - wanted) > slack:
            return f"{name}: value {value:.6g}: the cell says {wanted:.6g}"
    return None
