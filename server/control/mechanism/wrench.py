"""Contact wrench at the MRF, from a wrist sensor whose payload is taken off, weight and inertia."""

import math
from typing import Final, NamedTuple

import numpy as np

from ..compiled import ARRAY3, FLAG, MATRIX, NUMBER, STACK, TABLE, VECTOR, compiled, inner_kernel
from ..inputs import Inputs, Intent, Payload
from ..spatial import GRAVITY, Array, Pose, wrench_to

# --- Contact wrench at the MRF, from a wrist sensor whose payload's weight and inertia are taken
# off
#
# The wrench is what the arm exerts on its environment, without the weight and the inertial
# forces of everything outboard of the sensor.
#
# Both are taken from the *measured* joints, at the instant of the sample. An acceleration is a
# second difference, so it is known one period late; half of that is bridged by its own trend,
# and the wrench is brought to the same instant as a mean of two: `INERTIA_PERIODS` of delay,
# which the stability bound counts.
#
# For whatever is as light as a hand's virtual mass this is too rough. Drives run from setpoint
# to setpoint in jerks, of which one newest sample sees a part that depends on its instant. So
# there is a second wrench, a little later: the reading is the sensor's mean over a period, and
# the mean of two is that over two periods, weighted as a triangle. So is the second difference
# of places; the payload's own force falls out of `hand` whatever the tool does between two
# SYNCs.

INERTIA_PERIODS = 0.5
"""Delay of the wrench where inertial forces are taken off [periods]."""

MEAN_PERIODS = 0.5
"""Delay of a reading that is the mean over a period; for `hand`, on top of the other [periods]."""

_OLDEST = 1.0
"""An instant is interpolated between the last two SYNCs, so at most this old [periods]."""


def load_of(mass: float, com: Array, bias: Array) -> Array:
    """Return what the sensor carries and adds by itself (10,): m [kg], m·com (3,), bias (6,).

    All that is taken off a reading is linear in these ten numbers, so that ramping them ramps it.
    """
    return np.concatenate([[mass], mass * com, bias])


_NOWHERE: Final = np.empty((0, 3, 4))


class WrenchState(NamedTuple):
    """State of the filter for the next sample; empty before the first one and after a stale one."""

    wrench: Array | None = None
    """Filtered contact wrench (6,) at and in the Sensor frame."""
    contact: Array | None = None
    """The newest wrench (6,) without weight, not filtered."""
    places: Array = _NOWHERE
    """T_world_sensor at the newest SYNCs, newest first (0 to 4, 3, 4): R and p side by side."""
    hand: Array | None = None
    """Filtered contact wrench (6,) of the mean readings, at and in the Sensor frame."""
    mean: Array | None = None
    """The newest mean reading (6,) without weight, not filtered."""
    time_s: float = 0.0


class ContactWrench:
    """Estimates the contact wrench of one sensor.

    `calibration` (6, 6) maps a reading without bias to the wrench in the Sensor's axes. The
    payload's acceleration is believed up to `max_acceleration` [m/s²] beyond the commanded one:
    more means that SYNC was late, not that the tool was quick. Without `inertia`, only weight is
    taken off, and nothing is delayed.
    """

    def __init__(
        self,
        T_wrist_sensor: Pose,
        smoothing: float,
        period_s: float,
        calibration: Array | None = None,
        inertia: bool = True,
        max_acceleration: float = math.inf,
    ) -> None:
        self.T_wrist_sensor = T_wrist_sensor
        self.inertia = inertia
        self._smoothing = smoothing
        self._period_s = period_s
        self._calibration = np.eye(6) if calibration is None else calibration
        self._reading_of = np.linalg.inv(self._calibration)
        self._max_acceleration = max_acceleration
        # Scratch: the two frames asked for last, and the Sensor in them; the latest first.
        self._frames = [(Pose.identity(), T_wrist_sensor)] * 2

    def weight(self, R_world_sensor: Array, load: Array) -> Array:
        """Return the reading (6,) that the payload's weight alone makes, exerted sign."""
        return np.asarray(self._reading_of @ _held(load, R_world_sensor.T @ -GRAVITY))

    def measure(
        self,
        state: WrenchState,
        sample: Array | None,
        load: Array,
        T_world_wrist: Pose,
        time_s: float = 0.0,
        age_s: float = 0.0,
        free_fall: Array = GRAVITY,
        commanded: float = 0.0,
        mean: tuple[Array, float] | None = None,
    ) -> WrenchState:
        """Return the state after one sample (6,), None when stale.

        `T_world_wrist` is the measured Wrist pose at the last SYNC, `age_s` how much older the
        sample is [s], `time_s` the tick's time [s], `free_fall` (3,) how what is let go accelerates
        there [m/s²]: a Base that accelerates may stand for World, with its own acceleration in it.
        `commanded` is the greatest acceleration that the tool was lately told [m/s²], `mean` the
        mean of the period's samples (6,) and its age [s]; None: the newest stands for all.
        """
        if sample is None:
            return WrenchState()
        if time_s - state.time_s > 1.5 * self._period_s:
            # Ticks were missed: differences would be wrong.
            state = WrenchState(state.wrench, hand=state.hand)
        whole, whole_age_s = (sample, age_s) if mean is None else mean
        last, before = state.contact, state.wrench
        wrenches, places = np.empty((4, 6)), np.zeros((min(len(state.places) + 1, 4), 3, 4))
        _see(
            *T_world_wrist,
            *self.T_wrist_sensor,
            state.places,
            self._calibration,
            sample,
            whole,
            load,
            free_fall,
            sample if last is None else last,
            sample if before is None else before,
            sample if state.mean is None else state.mean,
            sample if state.hand is None else state.hand,
            age_s,
            whole_age_s,
            self._period_s,
            self._max_acceleration + commanded,
            1.0 if before is None else self._smoothing,
            self.inertia and last is not None,
            wrenches,
            places,
        )
        return WrenchState(wrenches[0], wrenches[1], places, wrenches[2], wrenches[3], time_s)

    def at_mrf(self, state: WrenchState, T_wrist_mrf: Pose) -> tuple[Array | None, Array | None]:
        """Return the contact wrench (6,) at and in the MRF (eq. 5), and that of the mean readings.

        The latter is for what a payload's own force would upset. Both are None when stale.
        """
        if state.wrench is None or state.hand is None:
            return None, None
        latest, other = self._frames
        if T_wrist_mrf is not latest[0]:
            if T_wrist_mrf is not other[0]:
                other = (T_wrist_mrf, T_wrist_mrf.inverse() @ self.T_wrist_sensor)
            self._frames = [other, latest]
        T_mrf_sensor = self._frames[0][1]
        return wrench_to(T_mrf_sensor, state.wrench), wrench_to(T_mrf_sensor, state.hand)


@compiled(VECTOR, VECTOR)
def _held(load: Array, acceleration: Array) -> Array:
    """Return the wrench (6,) exerted on the load to give it an acceleration (3,), Sensor axes.

    Holding it up against gravity is accelerating it upwards by 9.81 m/s².
    """
    x, y, z = load[1], load[2], load[3]
    ax, ay, az = acceleration[0], acceleration[1], acceleration[2]
    out = np.empty(6)
    for i in range(3):
        out[i] = load[0] * acceleration[i]
    out[3], out[4], out[5] = y * az - z * ay, z * ax - x * az, x * ay - y * ax
    return out


@inner_kernel
def _follow(
    R: Array, p: Array, R_wrist_sensor: Array, p_wrist_sensor: Array, places: Array, out: Array
) -> None:
    """Write placements (k, 3, 4) with a newer one before them, the newest four.

    The newer one is that of the Sensor on a Wrist at R, p. `out` is zeros before.
    """
    for i in range(3):
        for k in range(3):
            for j in range(3):
                out[0, i, j] += R[i, k] * R_wrist_sensor[k, j]
            out[0, i, 3] += R[i, k] * p_wrist_sensor[k]
        out[0, i, 3] += p[i]
    for s in range(1, len(out)):
        for i in range(3):
            for j in range(4):
                out[s, i, j] = places[s - 1, i, j]


@inner_kernel
def _unladen(
    calibration: Array, sample: Array, load: Array, places: Array, free_fall: Array, older: float
) -> Array:
    """Return a sample (6,) without bias and weight, `older` periods before the newest place."""
    before, up = min(1, len(places) - 1), np.zeros(3)
    for i in range(3):
        for k in range(3):
            up[i] -= ((1.0 - older) * places[0, k, i] + older * places[before, k, i]) * free_fall[k]
    out = _held(load, up)
    for i in range(6):
        out[i] = -out[i]
        for k in range(6):
            out[i] += calibration[i, k] * (sample[k] - load[4 + k])
    return out


@inner_kernel
def _inertial(load: Array, places: Array, ahead: float, period_s: float, bound: float) -> Array:
    """Return the wrench (6,) that accelerates the payload, the trend carried `ahead` periods on.

    From the Sensor at the last four SYNCs (4, 3, 4). The second difference of the centre of mass
    itself holds all of `a + α × r + ω × (ω × r)`. `bound` is the greatest acceleration that is
    believed [m/s²].
    """
    x, a, size2 = np.empty((4, 3)), np.empty(3), 0.0
    for i in range(3):
        for s in range(4):
            x[s, i] = places[s, i, 3]
            for k in range(3):
                x[s, i] += places[s, i, k] * load[1 + k] / load[0]
        newer = x[0, i] - 2.0 * x[1, i] + x[2, i]  # one period ago
        before = x[1, i] - 2.0 * x[2, i] + x[3, i]  # two
        a[i] = (newer + ahead * (newer - before)) / period_s**2
        size2 += a[i] ** 2
    share = min(1.0, bound / math.sqrt(size2)) if size2 > 0.0 else 1.0
    turned = np.zeros(3)
    for i in range(3):
        for k in range(3):
            turned[i] += places[1, k, i] * share * a[k]
    return _held(load, turned)


@compiled(
    MATRIX, VECTOR, MATRIX, VECTOR, ARRAY3, MATRIX,
    VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR,
    NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, FLAG, TABLE, STACK,
)  # fmt: skip
def _see(
    R: Array, p: Array, R_wrist_sensor: Array, p_wrist_sensor: Array, places: Array,
    calibration: Array, sample: Array, mean: Array, load: Array, free_fall: Array,
    last: Array, before: Array, last_mean: Array, hand_before: Array,
    age_s: float, mean_age_s: float, period_s: float, bound: float, smoothing: float,
    inertia: bool, wrenches: Array, at: Array,
) -> None:  # fmt: skip
    """Write the filtered wrench, the newest without weight, hand and mean (4, 6), and placements.

    The Wrist is at R, p. With `inertia`, the newest is taken in the mean with the `last` one, and
    the payload's acceleration is taken off as soon as four placements tell it. `smoothing` is the
    share of what is new that is taken over `before` (6,), the filtered wrench of the tick before.
    The last two are the same of the period's `mean` reading, which needs no trend carried on.
    """
    older = min(max(age_s / period_s, 0.0), _OLDEST)
    mean_older = min(max(mean_age_s / period_s, 0.0), _OLDEST)
    _follow(R, p, R_wrist_sensor, p_wrist_sensor, places, at)
    newest = _unladen(calibration, sample, load, at, free_fall, older)
    whole = _unladen(calibration, mean, load, at, free_fall, mean_older)
    carried, swung = np.zeros(6), np.zeros(6)
    if inertia and len(at) == 4 and load[0] > 0.0:
        carried = _inertial(load, at, 1.0 - INERTIA_PERIODS - older, period_s, bound)
        swung = _inertial(load, at, 0.0, period_s, bound)
    for i in range(6):
        contact, felt = newest[i], whole[i]
        if inertia:
            contact = 0.5 * (newest[i] + last[i]) - carried[i]
            felt = 0.5 * (whole[i] + last_mean[i]) - swung[i]
        wrenches[0, i] = before[i] + smoothing * (contact - before[i])
        wrenches[1, i] = newest[i]
        wrenches[2, i] = hand_before[i] + smoothing * (felt - hand_before[i])
        wrenches[3, i] = whole[i]


# --- Payload on the force/torque sensor -----------------------------------------------------------


# --- Contact wrench of one wrist's sensor, with the load in effect taken off ----------------------

OVERSHOOT = 2.0
"""A tool may be accelerated by this times what it was told: drives overshoot [1]."""

LOAD_TIME_S = 0.15
"""Time constant with which a changed payload or bias takes effect [s]."""


class WristMemory(NamedTuple):
    """Memory of a wrist from tick to tick."""

    wrench: WrenchState = WrenchState()
    load: Array | None = None
    """Payload and bias in effect (10,), see `contact_wrench.load_of`."""


class Wrist:
    """The force/torque sensor of one mechanism, and what hangs on it."""

    def __init__(self, contact: ContactWrench, payload: Payload, period_s: float) -> None:
        """Build it; `payload` is the cell's own, unless an operator says otherwise."""
        self.contact = contact
        self._payload = payload
        self._part = 1.0 - math.exp(-period_s / LOAD_TIME_S)
        # Scratch: payload, bias and both as a load, of the tick before.
        self._hung: tuple[Payload | None, Array | None, Array] = (None, None, np.zeros(10))

    def load(self, payload: Payload | None, bias: Array) -> Array:
        """Return a payload, None for the cell's own, and a bias (6,) as a load (10,)."""
        payload = payload or self._payload
        if payload is not self._hung[0] or bias is not self._hung[1]:
            self._hung = payload, bias, load_of(payload.mass, payload.com, bias)
        return self._hung[2]

    def measure(
        self,
        memory: WristMemory,
        inputs: Inputs,
        T_world_wrist: Pose,
        max_tool_acceleration: float,
    ) -> WristMemory:
        """Return the memory with the newest wrench in it, payload and bias taken off.

        The load in effect goes smoothly to what is told: a tool picked up or a tare never jumps;
        at a seed it is there at once. `T_world_wrist` is measured, at the instant that the joints
        were; `max_tool_acceleration` is the greatest that the tool was lately told [m/s²].
        """
        settings, moved, load = inputs.settings, inputs.moved, memory.load
        target = self.load(settings.payload, settings.wrench_bias)
        if load is None or inputs.intent is Intent.SEED:
            load = target
        else:
            load = load + self._part * (target - load)
        place, free_fall = T_world_wrist, GRAVITY
        if moved is not None:
            # Seen from a Base that moves: its news is too rough to be differentiated twice.
            base = moved.T_world_base_measured
            place = base.inverse() @ T_world_wrist
            free_fall = base.R.T @ (GRAVITY - moved.acceleration_at(T_world_wrist.p))
        wrench = self.contact.measure(
            memory.wrench,
            inputs.wrench_sensor,
            load,
            place,
            inputs.time_s,
            inputs.wrench_age_s,
            free_fall,
            OVERSHOOT * max_tool_acceleration,
            inputs.wrench_mean,
        )
        return WristMemory(wrench, load)

    def weight(
        self, T_world_mrf: Pose, T_wrist_mrf: Pose, payload: Payload | None, bias: Array
    ) -> Array:
        """Return the sensor reading (6,) of the payload's weight with the MRF at a pose."""
        T_world_wrist = T_world_mrf @ T_wrist_mrf.inverse()
        R_world_sensor = T_world_wrist.R @ self.contact.T_wrist_sensor.R
        return self.contact.weight(R_world_sensor, self.load(payload, bias))
