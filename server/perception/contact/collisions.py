"""Collision monitor: contact that no sensor sees, and the joint that it pushes."""

import numpy as np

from ....config.schema.mechanism.touch import TouchSection
from ...control.frame_tree import Moved
from ...control.hold.pushed import Pushed
from ...control.mechanism.dynamics import dynamics_of
from ...control.mechanism.kinematics import Mechanism
from ...control.parameters import Parameters
from ...control.spatial import GRAVITY, Array
from ...control.state import Memory, Output
from ...mode import Mode
from ...plant import UnitReading
from ...runtime.events import Events
from ..filters.collision import CollisionDetector, DetectorState, LoadUncertainty, SensorLoad
from .release import ContactRelease
from .tool import ToolContact

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
        self._lost_after = round(LOST_S / p.period_s)
        self._blind_ticks = 0
        self._giving = ContactRelease(p, events, in_tunnels)
        self._carried_within = p.friction + (0.0 if section is None else np.array(section.torque))
        self._unwatched = Pushed(np.zeros(p.n), np.zeros(p.n), p.friction + UNWATCHED)

    @property
    def external(self) -> Array | None:
        """Torques (n,) of unseen contact [N·m], one period ago; None where not watched."""
        return self._state.external

    @property
    def stopping(self) -> bool:
        """True while something pushes that the arm has stopped for."""
        return self._giving.touched and not self._giving.withdraws

    @property
    def withdraws(self) -> bool:
        """True while an arm in tunnels may move, but only back from what pushes it."""
        return self._giving.withdraws

    @property
    def carried(self) -> bool:
        """True while the drives carry what the sensor reads, but for friction: it is a weight."""
        external = self._state.external
        return external is not None and bool((np.abs(external) <= self._carried_within).all())

    @property
    def pushed(self) -> Pushed | None:
        """External joint torques, and whether the arm is to give way; None where not known."""
        return self._giving.pushed

    def update(
        self,
        reading: UnitReading,
        memory: Memory | None,
        output: Output | None,
        moved: Moved,
        mode: Mode,
        doubt: LoadUncertainty | None = None,
        tool: ToolContact | None = None,
    ) -> None:
        """Take in a reading, and what the tick before made of the one before.

        `doubt` is what the sensor's load may be off by, `tool` the tool's contact meanwhile. What
        pushes an arm that is long at rest in HOLD may stay until it is to move.
        """
        if self._detector is None:
            self._giving.update(None, tool, self._unwatched, mode, memory, output)
            return
        if reading.q is None or not reading.enabled or memory is None or memory.wrist.load is None:
            self._state, self._blind_ticks = DetectorState(), 0
            self._giving.reset()
            return
        load = self._carried(reading, memory.wrist.load)
        base = moved.T_world_base_measured
        free_fall = base.R.T @ (GRAVITY - moved.acceleration_at(base.p))
        self._detector.dynamics.fall(free_fall)
        before = self._state.external
        self._state = self._detector.measure(
            self._state, reading.q, reading.tau, load, reading.sampled_s, doubt
        )
        self._tell_blind(self._state.external is before)
        found, pushed = self._detector.touched(self._state), self._detector.pushed(self._state)
        self._giving.update(found, tool, pushed, mode, memory, output)

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
        wrench = self._calibration @ (mean.wrench - load[4:])
        return SensorLoad(wrench, self._calibration @ mean.jump, reading.wrench_mean_lag_s)

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
    dynamics = dynamics_of(mechanism, p.rotor_inertia, p.T_wrist_sensor)
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
