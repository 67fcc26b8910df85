"""Frame tracker: which news of moving frames is believed, its age, and where they are now.

News names the telemetry tick in which it was measured, so that its lateness is made up for. Every
piece that is not believed, and a frame lost and found again, is an event; a row of equal doubts is
one.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from ...config.load import Cell
from ...config.schema.cell import LimitsSection
from ...config.schema.section import PoseSection
from ...config.schema.surroundings import FramesSection, MovingFrameSection
from ...protocols.messages.perception import FrameNews
from ..control.scene import Body, Moved
from ..control.spatial import Array, Motion, Pose, rotate_twist, rotation_exp
from ..events import Events
from ..refusals import Refused, Why
from .ahead import BaseTracker
from .filters import (
    Follower,
    FollowerState,
    NewsRejection,
    PlausibleMotion,
    RejectedNews,
    Track,
    update_track,
)

DISPUTED = 4
"""So often within two timeouts news contradicts what was just believed: two senders tell of it."""
AGREED = 4
"""Senders that have not contradicted each other for so long agree [timeouts]."""
LEAD_PERIODS = 1.0
"""The pose that a tick starts from is reached at the next SYNC [periods]."""


@dataclass
class _Tracked:
    """One frame that may move."""

    plausible: PlausibleMotion
    timeout: int
    """News is stale after so many ticks."""
    follower: Follower
    followed: FollowerState
    track: Track | None = None
    doubt: RejectedNews | None = None
    """Why the newest news was not believed."""
    contradicted: deque[int] = field(default_factory=lambda: deque(maxlen=DISPUTED))
    """Ticks in which news contradicted what was believed just before."""
    disputed: bool = False

    def note(self, doubt: RejectedNews | None, tick: int) -> None:
        """Take note of why news was not believed, None for news that was."""
        if doubt is not None and doubt.contradicts and self.doubt is None:
            self.contradicted.append(tick)
            often = len(self.contradicted) == DISPUTED
            self.disputed |= often and tick - self.contradicted[0] <= 2 * self.timeout
        self.doubt = doubt


class FrameTracker:
    """Tracks all frames of a cell that may move."""

    def __init__(
        self,
        frames: FramesSection,
        T_world_base: PoseSection,
        limits: LimitsSection,
        period: float,
        events: Events,
        base: BaseTracker | None = None,
        carried: bool = False,
    ) -> None:
        """Begin with frames that stand; `limits` bound the jerk at which they are followed.

        `base` tracks a Base that rolls; None for one that does not. One that is `carried` is where
        the torso has it that it stands on.
        """
        self._events = events
        self.base = base
        self._carried: Moved | None = None
        self._lead_s = LEAD_PERIODS * period + frames.drive_lag_s
        self._standing = {
            "base": Pose.from_xyz_rpy(T_world_base.xyz, T_world_base.rpy),
            "carrier": Pose.from_xyz_rpy(frames.T_world_carrier.xyz, frames.T_world_carrier.rpy),
        }
        self._tracked = {
            name: self._track_of(config, self._standing[name], limits, period)
            for name, config in frames.moving.items()
        }
        rolls = base is not None and "base" not in self._tracked
        self.names = (*(("base",) if rolls or carried else ()), *self._tracked)
        """The frames that may move."""
        self.watching = bool(self._tracked) or base is not None or carried
        """There are any."""
        self.moved = self._moved()
        """Where Base and Carrier are, for this tick's command."""

    @classmethod
    def from_cell(cls, cell: Cell, events: Events) -> Self:
        """Return the tracker of a loaded cell."""
        c = cell.config
        return cls(
            c.frames, c.mechanism.T_world_base, c.limits, c.timing.period_s, events,
            BaseTracker.from_cell(cell, events), c.mechanism.on is not None,
        )  # fmt: skip

    @property
    def disputed(self) -> str | None:
        """The frame of which two senders tell different things, None without one."""
        for name, tracked in self._tracked.items():
            if tracked.disputed:
                return name
        return None

    def age(self, name: str, tick: int) -> int | None:
        """Return how many ticks old the newest news of a frame is, None when stale."""
        tracked = self._tracked.get(name)
        track = None if tracked is None else tracked.track
        return None if tracked is None or track is None or tracked.disputed else tick - track.tick

    def take(self, news: FrameNews, tick: int, seen_by: "FrameTracker | None" = None) -> None:
        """Take in where a frame was. Raises `Refused` for one that does not move in this cell.

        What is seen from Base is so from that which `seen_by` tracks; None: this one does.
        """
        tracked = self._tracked.get(news.name)
        if news.name == "base" and news.heading and self.base is not None and tick >= news.tick:
            self.base.take_heading(news.tick, news.rpy[2])
            return
        if tracked is None:
            known = ", ".join(self._tracked) or "none"
            detail = f"{news.name!r} does not move here; there is: {known}"
            if news.name == "base" and self.base is not None:
                detail = "a base on wheels takes poses where the cell has [frames.base]"
            raise Refused(Why.UNKNOWN_FRAME, detail)
        if news.tick > tick:
            raise Refused(Why.FUTURE_PICTURE, f"tick {news.tick}, this is tick {tick}")
        believed = self._judge(tracked, news, tick, seen_by or self)
        if isinstance(believed, RejectedNews):
            if tracked.doubt is None or believed.doubt is not tracked.doubt.doubt:
                self._tell("frame_rejected", news.name, believed)
            before = tracked.disputed
            tracked.note(believed, tick)
            if tracked.disputed and not before:
                self._tell("frame_disputed", news.name, believed)
            return
        if tracked.track is None:
            self._events.info("frame_found", news.name, frame=news.name)
        tracked.note(None, tick)
        tracked.track = believed
        if news.name == "base" and self.base is not None and not tracked.disputed:
            self.base.take_pose(believed.tick, believed.T)

    def step(
        self, tick: int, *, moving: bool, commanded: Motion | None = None, q: Array | None = None
    ) -> Moved:
        """Return where the frames are for the command of `tick`; `moving`: sources lead the arm.

        A Base that rolls is where its wheels say: by what they were told last, and joints that are
        measured at q (n,) [rad].
        """
        for name, w in self._tracked.items():
            if w.track is not None and tick - w.track.tick > w.timeout:
                w.track = None
                # News that only repeats what was believed is no reason why newer is missing.
                stale = w.doubt is not None and w.doubt.doubt is NewsRejection.OUT_OF_ORDER
                self._tell("frame_lost", name, None if stale else w.doubt)
            if w.disputed and tick - w.contradicted[-1] > AGREED * w.timeout:
                w.disputed = False
                w.contradicted.clear()
                if w.track is not None:
                    self._events.info("frame_found", name, frame=name)
            track = None if w.disputed else w.track
            w.followed = w.follower.step(w.followed, track, tick, self._lead_s, not moving)
        if self._tracked:
            self.moved = self._moved()
        if self.base is not None and q is not None:
            rolled = self.base.step(tick, commanded, q)
            measured = self.base.odometry.measured
            self.moved = Moved(rolled, self.body("carrier"), measured)
        return self.moved

    def carry(self, base: Moved) -> Moved:
        """Return where the frames are, with Base where a torso has it."""
        self._carried = base
        self.moved = self._moved()
        return self.moved

    def _moved(self) -> Moved:
        if self._carried is not None:
            return self._carried._replace(carrier=self.body("carrier"))
        base = self.body("base")
        back = -self._lead_s * base.twist
        measured = Pose(rotation_exp(back[3:]) @ base.T.R, base.T.p + back[:3])
        tracked = self._tracked.get("base")
        track = None if tracked is None or tracked.disputed else tracked.track
        acceleration = None if track is None else track.acceleration
        return Moved(base, self.body("carrier"), measured, acceleration)

    def body(self, name: str) -> Body:
        """Return where Base or Carrier is, for this tick's command."""
        if name == "base" and self.base is not None:
            return self.base.odometry.body(self.base.twist)
        if name == "base" and self._carried is not None:
            return self._carried.base
        tracked = self._tracked.get(name)
        return Body.standing(self._standing[name]) if tracked is None else tracked.followed.now

    @staticmethod
    def _track_of(
        config: MovingFrameSection, home: Pose, limits: LimitsSection, period: float
    ) -> _Tracked:

        def bounds(linear: float, angular: float) -> np.ndarray:
            return np.repeat([linear, angular], 3)

        plausible = PlausibleMotion(
            period,
            config.least_quality,
            config.speed,
            config.angular_speed,
            *config.slack,
            config.smoothing_s,
            config.acceleration,
            config.angular_acceleration,
            config.extent or (math.inf, math.inf),
            home,
        )
        follower = Follower(
            bounds(config.speed, config.angular_speed),
            bounds(config.acceleration, config.angular_acceleration),
            bounds(limits.jerk, limits.angular_jerk),
            period,
        )
        timeout = round(config.timeout_s / period)
        return _Tracked(plausible, timeout, follower, follower.standing(home))

    @staticmethod
    def _judge(
        tracked: _Tracked, news: FrameNews, tick: int, seen_by: "FrameTracker"
    ) -> Track | RejectedNews:
        if tick - news.tick > tracked.timeout:
            return RejectedNews(NewsRejection.LATE, tick - news.tick, tracked.timeout, "ticks")
        T = Pose.from_xyz_rpy(news.xyz, news.rpy)
        twist = None if news.twist is None else np.array(news.twist)
        if news.seen_from == "base":
            base = seen_by.base_at(news.tick, tick)
            T = base.T @ T
            if twist is not None:
                twist = rotate_twist(base.T.R, twist) + base.twist_at(T.p)
        return update_track(tracked.track, news.tick, T, twist, news.quality, tracked.plausible)

    def base_at(self, then: int, tick: int) -> Body:
        """Return Base as it was at a tick, a little while before `tick`."""
        tracked = self._tracked.get("base")
        if self.base is not None:
            return self.body("base")
        if tracked is None:
            return Body.standing(self._standing["base"])
        period = tracked.plausible.period_s
        if tracked.track is not None:
            return tracked.track.at((then - tracked.track.tick) * period)
        # What comes to rest is where it was, but for what it moved since.
        now = tracked.followed.now
        back = -((tick - then) * period + self._lead_s) * now.twist
        return Body(Pose(rotation_exp(back[3:]) @ now.T.R, now.T.p + back[:3]), now.twist)

    def _tell(self, event: str, name: str, doubted: RejectedNews | None) -> None:
        """Tell why news was not believed, with value and bound; None: there was none."""
        if doubted is None:
            reason = str(NewsRejection.NO_NEWS)
            self._events.warning(event, f"{name}: {reason}", frame=name, reason=reason)
            return
        self._events.warning(
            event,
            f"{name}: {doubted.words}",
            frame=name,
            reason=str(doubted.doubt),
            value=float(f"{doubted.value:.4g}"),
            bound=float(f"{doubted.bound:.4g}"),
        )
