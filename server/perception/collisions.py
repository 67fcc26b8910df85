"""Contact that no sensor sees: felt at the joints, latched until it is over, and told."""

from collections import deque
from collections.abc import Sequence
from enum import Enum, auto
from typing import Final, NamedTuple

import numpy as np

from ...config.schema.mechanism import TouchSection
from ..control.arm import Arm
from ..control.bodies.rates import ArmTick
from ..control.hold import LOOKBACK_S, released, tool_released
from ..control.inputs import Pushed
from ..control.mechanism.model import Dynamics, Mechanism
from ..control.parameters import Parameters
from ..control.scene import Moved
from ..control.spatial import GRAVITY, Array, exceeds, product, sizes
from ..control.state import ArmMemory
from ..events import Events
from ..mode import Mode
from ..plant import UnitReading
from .contact import MARGIN_N, ToolContact
from .filters import CollisionDetector, DetectorState, JointContact, LoadUncertainty, SensorLoad

# --- Release news: operators are told what was touched, and how far the arm gave way to it --------

SETTLED_S = 0.3
"""An arm that asked for no retreat for so long has given way as far as it will [s]."""


class _Told(Enum):
    """Stages of giving way that operators were told of."""

    NOTHING = auto()
    GIVING = auto()
    GAVE = auto()
    STUCK = auto()


class ReleaseNews:
    """Tells each stage of giving way once."""

    def __init__(
        self, joints: Sequence[str], leash: float | None, period_s: float, events: Events
    ) -> None:
        self._joints, self._leash, self._T, self._events = joints, leash, period_s, events
        self._settled_s = 0.0
        self._told = _Told.NOTHING

    def reset(self) -> None:
        """Begin anew: what is touched next is told from its first stage."""
        self._told = _Told.NOTHING

    def touched(self, found: JointContact | ToolContact) -> None:
        """Tell that the arm stops for contact."""
        if isinstance(found, ToolContact):
            self._events.warning(
                "touched",
                f"tool: {found.off_n:.1f} N off the load of {found.known_n:.1f} N, "
                f"contact means {found.bound_n:.1f}",
                joint="tool",
                force_n=found.off_n,
                bound_n=found.bound_n,
            )
            return
        joint = self._joints[found.joint]
        self._events.warning(
            "touched",
            f"{joint}: {found.torque:+.1f} N·m that nothing explains, "
            f"contact means {found.bound:g}",
            joint=joint,
            torque_nm=found.torque,
            bound_nm=found.bound,
        )

    def gives_way(self, pushed: Pushed, memory: ArmMemory, tool_only: bool) -> None:
        """Tell how far an arm in HOLD has given way, and whether something still pushes it."""
        state = memory.retreat
        if state is None:
            return
        held = memory.held
        giving = state.rate > 0.0 or (held is not None and held.force.bleeding)
        self._settled_s = 0.0 if giving else self._settled_s + self._T
        if giving:
            now = _Told.GIVING
        elif self._settled_s < SETTLED_S:
            return
        else:
            now = _Told.STUCK if pushed.lasting else _Told.GAVE
        if now is self._told:
            return
        self._told = now
        what, push, values = self._push(pushed, tool_only)
        way = values["travelled_rad"] = float(state.travelled.max(initial=0.0))
        far = f"by {way:.4f} rad of {self._leash:g}" if held is None else "at its grasp"
        left = f"{far}; {what} is left with {push}"
        if now is _Told.GIVING:
            self._events.info("giving_way", f"to {push} at {what}", **values)
        elif now is _Told.GAVE:
            self._events.info("gave_way", left, **values)
        else:
            self._events.warning("still_pushed", f"gave way {left}, and is still pushed", **values)

    def _push(self, pushed: Pushed, tool_only: bool) -> tuple[str, str, dict[str, str | float]]:
        """Return what is pushed, by how much, and the values of an event that says so."""
        if tool_only:
            force = 0.0
            if pushed.steady is not None and pushed.free_wrench is not None:
                force = sizes(pushed.steady - pushed.free_wrench)[0]
            return "the tool", f"{force:.1f} N", {"joint": "tool", "force_n": force}
        j = int(np.argmax(np.abs(pushed.external)))
        joint, torque = self._joints[j], float(pushed.external[j])
        return joint, f"{torque:+.1f} N·m", {"joint": joint, "torque_nm": torque}


# --- Contact release: latches a contact until it is over, and tells how far the arm gave way ------

OVER_S = 0.2
"""A touch is over once nothing has pushed for so long [s]."""

COMING_TO_REST_S = 0.5
"""A contact that is felt so long after the arm came to rest is one that it ran into [s]."""

STEADY_S = 0.2
"""The wrench on the tool is averaged over this time [s]."""


class _Push(NamedTuple):
    """Push that was measured in a tick: at the joints (n,), and at the tool (6,) if it is seen."""

    external: Array | None = None
    wrench: Array | None = None
    steady: Array | None = None
    """The mean of that over the last ticks; None where nobody asks for it."""


class ContactRelease:
    """Decides what a contact means in each mode."""

    def __init__(self, p: Parameters, events: Events, in_tunnels: bool = False) -> None:
        """Build it; an arm `in_tunnels` may be told to withdraw from what still pushes it."""
        self._in_tunnels = in_tunnels
        self._T = p.period_s
        self._news = ReleaseNews(p.joints.names, p.retreat_leash, p.period_s, events)
        self.touched = False
        """True while something pushes that the arm has stopped for."""
        self.withdraws = False
        """An arm in tunnels has stopped for it: from now on it may move, and only back."""
        self.pushed: Pushed | None = None
        """The newest estimate, and whether the arm is to give way to it."""
        self._giving = False
        self._past: deque[_Push] = deque(maxlen=round(LOOKBACK_S / p.period_s))
        self._free: _Push | None = None
        self._tool_free: Array | None = None
        """Mean wrench on the tool (6,), the newest before it was touched."""
        self._seen: deque[Array] = deque(maxlen=max(1, round(STEADY_S / p.period_s)))
        """The latest wrenches on the tool (6,) each."""
        self._rested_s = np.inf
        self._free_s = self._tool_free_s = 0.0
        self._tool = self._tool_lasting = False

    def update(
        self,
        found: JointContact | None,
        tool: ToolContact | None,
        pushed: Pushed | None,
        wrench: Array | None,
        mode: Mode,
        memory: ArmMemory | None,
        output: ArmTick | None,
    ) -> None:
        """Take in whether contact was `found` in this tick, and the estimate behind it.

        `tool` is contact of the tool while its load is not explained. `memory` and `output` are the
        tick's before, and so is the `wrench` (6,) that the tool was seen to exert, at the MRF in
        World axes.
        """
        if not mode.energised or memory is None or output is None:
            self.reset()
            return
        self._rested_s = self._rested_s + self._T if output.motion.stands() else 0.0
        self._latch(found, tool, mode)
        if self.touched or self.withdraws:
            self._last(pushed, mode)
        if pushed is None:
            self.pushed = None
            return
        push = steady = None
        if wrench is not None:
            push = -wrench
            self._seen.append(push)
            if tool is not None or self._giving:
                steady = np.mean(self._seen, axis=0)
        # What is touched next is judged by what pushed before.
        self._past.append(_Push(pushed.external, push, steady))
        self.pushed = self._given_way_to(pushed) if self._giving else pushed
        if self._giving and mode is Mode.HOLD:
            self._news.gives_way(self.pushed, memory, self._tool and not self.touched)

    def _latch(self, found: JointContact | None, tool: ToolContact | None, mode: Mode) -> None:
        """Begin to give way to contact that is new; end where the arm may move again."""
        touched = self.touched or (tool is not None and tool.touched and self._tool)
        if self._giving and mode is Mode.ENABLED and not touched:
            self._giving = self._tool = self._tool_lasting = False
            self._news.reset()
        if found is not None and not self.touched:
            self._found(found, mode)
        if tool is None:
            # The reading changes with what is told of the load: then the change is nobody's push.
            self._tool_free, self._tool = None, False
            return
        if tool.free and self._past and not self._giving:
            self._tool_free = self._past[0].steady
        if tool.found and not self._tool:
            self._found(tool, mode)

    def _last(self, pushed: Pushed | None, mode: Mode) -> None:
        """Let a touch last until nothing has pushed the joints for a while."""
        if self.touched:
            free = pushed is None or released(pushed)
            self._free_s = self._free_s + self._T if free else 0.0
            self.touched = self._free_s <= OVER_S
        stood = mode is Mode.HOLD and self._in_tunnels
        self.withdraws = self.touched and (self.withdraws or stood)

    def _given_way_to(self, pushed: Pushed) -> Pushed:
        """Return the estimate with what the newest push is compared with."""
        now, earlier = self._past[-1], _Push() if self._free is None else self._free
        told = pushed._replace(
            touched=True,
            free=earlier.external,
            wrench=now.wrench,
            steady=now.steady,
            free_wrench=earlier.wrench,
            tool_bound=MARGIN_N if self._tool else None,
        )
        self._tool_free_s = self._tool_free_s + self._T if tool_released(told) else 0.0
        self._tool_lasting = self._tool and self._tool_free_s <= OVER_S
        return told._replace(lasting=self.touched or self._tool_lasting)

    def reset(self) -> None:
        """Forget everything: the drives are off, or nothing is known."""
        self.touched = self.withdraws = False
        self._giving = self._tool = self._tool_lasting = False
        self.pushed = self._free = self._tool_free = None
        self._past.clear()
        self._seen.clear()
        self._free_s, self._rested_s = 0.0, np.inf
        self._news.reset()

    def _found(self, found: JointContact | ToolContact, mode: Mode) -> None:
        """Stop for contact that the arm ran into, and give way to it."""
        if not self._giving:
            if mode is not Mode.ENABLED and self._rested_s >= COMING_TO_REST_S:
                return
            self._news.touched(found)
            known = len(self._past) == self._past.maxlen
            self._free = self._past[0] if known else None
            if isinstance(found, ToolContact) and known and self._tool_free is not None:
                # Its bound is wider than a joint's, and contact may have begun long ago.
                self._free = _Push(self._past[0].external, self._tool_free)
        self._giving = True
        if isinstance(found, ToolContact):
            # It may be more load: resume stays allowed.
            self._tool, self._tool_free_s = True, 0.0
        else:
            self.touched, self._free_s = True, 0.0


# --- Collision monitor: contact that no sensor sees, and the joint that it pushes -----------------

UNWATCHED = 1.0
"""Where the drives' torques are not watched, this and friction are no push [N·m]."""

LOST_S = 0.5
"""Without an estimate for longer than this, it is said that nothing is felt [s]."""


class CollisionMonitor:
    """Collision detection of one cell; without `[touch]` the tool alone is felt, by the sensor."""

    def __init__(
        self,
        section: TouchSection | None,
        p: Parameters,
        mechanism: Mechanism,
        events: Events,
        in_tunnels: bool = False,
    ) -> None:
        self._events = events
        self._calibration = None if p.T_wrist_sensor is None else p.wrench_calibration
        self._detector = _detector(section, p, mechanism)
        self._state = DetectorState()
        self._moved: Moved | None = None
        """The Base by which the detector knows how things fall."""
        self._lost_after = round(LOST_S / p.period_s)
        self._blind_ticks = 0
        self.release = ContactRelease(p, events, in_tunnels)
        """What contact means now, and whether the arm is to give way to it."""
        self._carried_within = p.friction + (0.0 if section is None else np.array(section.torque))
        self._unwatched = Pushed(np.zeros(p.n), np.zeros(p.n), p.friction + UNWATCHED)

    @property
    def external(self) -> Array | None:
        """Torques (n,) of unseen contact [N·m], one period ago; None where not watched."""
        return self._state.external

    @property
    def carried(self) -> bool:
        """True while the drives carry what the sensor reads, but for friction: it is a weight."""
        external = self._state.external
        return external is not None and not exceeds(external, self._carried_within)

    def update(
        self,
        reading: UnitReading,
        memory: ArmMemory | None,
        output: ArmTick | None,
        wrench: Array | None,
        moved: Moved,
        mode: Mode,
        doubt: LoadUncertainty | None = None,
        tool: ToolContact | None = None,
    ) -> None:
        """Take in a reading, and what the tick before made of the one before.

        `wrench` (6,) is what that saw the tool exert, at the MRF in World axes, `doubt` what the
        sensor's load may be off by, `tool` the tool's contact meanwhile. What
        pushes an arm that is long at rest in HOLD may stay until it is to move.
        """
        if self._detector is None:
            self.release.update(None, tool, self._unwatched, wrench, mode, memory, output)
            return
        if reading.q is None or not reading.enabled or memory is None or memory.wrist.load is None:
            self._state, self._blind_ticks = DetectorState(), 0
            self.release.reset()
            return
        load = self._carried(reading, memory.wrist.load)
        if moved is not self._moved:
            self._moved, base = moved, moved.T_world_base_measured
            free_fall = base.R.T @ (GRAVITY - moved.acceleration_at(base.p))
            self._detector.dynamics.fall(free_fall)
        before = self._state.external
        self._state = state = self._detector.measure(
            self._state, reading.q, reading.tau, load, reading.sampled_s, doubt
        )
        blind = state.external is before
        if blind or self._blind_ticks:
            self._tell_blind(blind)
        found = self._detector.touched(state) if state.lasting_s > 0.0 else None
        pushed = self._detector.pushed(state)
        self.release.update(found, tool, pushed, wrench, mode, memory, output)

    def _carried(self, reading: UnitReading, load: Array) -> SensorLoad | None:
        """Return what the sensor reads; while it is stale, its payload is what the arm carries.

        Without a sensor that is what the URDF says. `load` (10,), see `contact_wrench.load_of`.
        """
        if self._detector is None or self._calibration is None:
            return None
        fresh = reading.wrench_mean is not None
        mass = 0.0 if fresh else float(load[0])
        self._detector.dynamics.carry(mass, load[1:4] / max(load[0], 1e-9))
        mean = reading.wrench_mean
        if mean is None:
            return None
        wrench = product(self._calibration, mean.wrench - load[4:])
        return SensorLoad(wrench, product(self._calibration, mean.jump), reading.wrench_mean_lag_s)

    def _tell_blind(self, blind: bool) -> None:
        was_lost = self._blind_ticks > self._lost_after
        self._blind_ticks = self._blind_ticks + 1 if blind else 0
        if self._blind_ticks == self._lost_after + 1:
            self._events.warning(
                "touch_lost",
                f"contact is not felt: for {LOST_S:g} s there were no three samples in a row"
                " of which it is known when they were taken",
            )
        elif was_lost and not blind:
            self._events.info("touch_found", "contact is felt again")


def _detector(
    section: TouchSection | None, p: Parameters, mechanism: Mechanism
) -> CollisionDetector | None:
    if section is None:
        return None
    dynamics = Dynamics(mechanism, p.rotor_inertia, p.T_wrist_sensor)
    bound = section.torque if len(section.torque) == p.n else section.torque * p.n
    return CollisionDetector(
        dynamics,
        p.friction,
        np.array(bound),
        section.doubt,
        section.filter_hz,
        section.confirm_s,
        p.period_s,
    )


# --- Wall monitor: tells of links beyond a wall of their tunnel, and of joints that do not follow
#
# Limits slow what leads into a wall. What stands in one already, since it was enabled there, a
# joint does not follow, or the tunnel is not where the cell says, is slowed by none of them: it
# is told.

LOOK_S: Final = 0.1
"""Walls are looked at so often [s]."""
BEYOND: Final = 1e-3
"""A link that is less beyond a wall may as well touch it [m]."""
WORSE: Final = 5e-3
"""One that has gone so much farther since it was told is told again [m]."""


class WallMonitor:
    """Tells when links come to stand beyond a wall, go farther, and are out of it again."""

    def __init__(self, arm: Arm, period_s: float, events: Events) -> None:
        self._arm, self._events = arm, events
        self._every = max(1, round(LOOK_S / period_s))
        self._ticks = 0
        self._told = 0.0
        """How far beyond it was when that was told last; 0: it is not beyond any [m]."""
        self._locked: frozenset[str] = frozenset()

    def update(self, memory: ArmMemory | None, q: Array | None) -> None:
        """Look at the measured joints q (n,) [rad], now and then."""
        self._ticks += 1
        if self._ticks % self._every or memory is None or q is None:
            return
        self._tell_locked(self._arm.locked_joints(memory))
        beyond = self._arm.body.beyond_wall(memory.insertion, q)
        if beyond > BEYOND and (not self._told or beyond > self._told + WORSE):
            self._told = beyond
            self._events.warning(
                "beyond_wall",
                f"a link stands {1e3 * beyond:.1f} mm beyond the wall of its tunnel",
                beyond_m=beyond,
            )
        elif self._told and beyond <= 0.0:
            self._told = 0.0
            self._events.info("off_wall", "no link stands beyond a wall any more")

    def _tell_locked(self, locked: dict[str, float]) -> None:
        for joint in [joint for joint in locked if joint not in self._locked]:
            self._events.warning(
                "joint_locked",
                f"{joint} stands at {locked[joint]:.3f} rad and does not follow",
                joint=joint,
                angle_rad=locked[joint],
            )
        self._locked = frozenset(locked)
