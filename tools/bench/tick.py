"""Time of one tick's control computation, of all arms, with every source and objective on.

Between two ticks there is a pause as in the daemon, in which caches go cold.
Among the ticks, a fixed piece of numpy is measured too: on a machine that others use, what a tick
takes beside it says more than microseconds.

No I/O: the control core is fed by a generator of its own. As in the daemon, the garbage collector
is off and SCHED_FIFO is asked for; where it is not granted, other programs show in the figures.
"""

import gc
import time

import numpy as np

from ...config.load import Cell, joint_part
from ...server.control.compiled import evolve
from ...server.control.inputs import (
    Inputs,
    Intent,
    ObjectiveGains,
    PathGoal,
    Settings,
    StickCommand,
    ViewGoal,
)
from ...server.control.mechanism.model import Mechanism
from ...server.control.spatial import Array, Pose
from ...server.control.tick import Control
from ...server.events import Events
from ...server.perception.obstacle_map import ObstacleMap
from ..host.machine import realtime
from .figures import Figures, percentiles

TARGET_US = 500.0  # the computation stays below this at p99 [µs]: 5 % of a period of 10 ms
TICKS, QUICK_TICKS = 4000, 400
WARM_UP = 50
PAUSE_S = 0.008
"""Between two ticks, as in the daemon: caches have gone cold when the next one begins [s]."""
REST_EVERY, REST_S = 200, 0.02
"""Ticks that go back to back, and a rest after them [s]: the kernel stops a real-time process that
never sleeps."""
TURN_EVERY = 120  # ticks between two changes of stick and target [1]
ARITHMETIC_EVERY = 25  # ticks between two pieces of arithmetic [1]
_A = np.random.default_rng(1).normal(0.0, 1.0, (6, 7))
EVERY_OBJECTIVE = {
    "mid_range": 0.2,
    "manipulability": 1.0,
    "posture": 0.2,
    "least_energy": 0.5,
    "field": 1.0,
    "spheres": 1.0,
}
"""Gains of the redundancy objectives while it is measured."""


def bench(cell: Cell, ticks: int = TICKS) -> Figures:
    """Measure a free phase (gentle stick) and a phase near limits (a stick that asks for more).

    Then one of both with no pause from tick to tick: what pauses cost is the machine's, not ours.
    """
    with realtime() as refusal:
        free = _measure(cell, ticks // 2, stick=0.05)
        limited = _measure(cell, ticks // 2, stick=2.0)
        warm = _measure(cell, ticks // 2, stick=0.5, paused=False)
    p99 = max(part["p99"] for part in (free.times, limited.times))
    return {
        "free_us": free.times,
        "limited_us": limited.times,
        "back_to_back_us": warm.times,
        "pause_ms": 1e3 * PAUSE_S,
        "limited_share": limited.limited_share,
        "arithmetic_us": percentiles(1e6 * np.array(free.arithmetic + limited.arithmetic)),
        "sched_fifo": not refusal,
        "p99_us": p99,
        "target_us": TARGET_US,
        "met": p99 < TARGET_US,
    }


def arithmetic() -> None:
    """Compute a fixed piece of numpy: ten products of a Jacobian's size, and a decomposition."""
    for _ in range(10):
        _A @ _A.T
    np.linalg.svd(_A)


class _Phase:
    """Result of a phase of the measurement."""

    def __init__(self, seconds: list[float], arithmetic: list[float], limited: int) -> None:
        self.times = percentiles(1e6 * np.array(seconds))
        self.arithmetic = arithmetic  # times of the fixed piece [s]
        self.limited_share = limited / len(seconds)


class _Operator:
    """Who leads one arm."""

    def __init__(self, cell: Cell, q: Array) -> None:
        objectives = ObjectiveGains(EVERY_OBJECTIVE, q)
        self.settings = evolve(settings_of(cell), objectives=objectives)
        # Goals lie about where the arm starts, so that it is led back however the stick pulls it.
        self._home = Mechanism.from_cell(cell).pose_wrist(q) @ self.settings.T_wrist_mrf
        self.command, self.goal = StickCommand(np.zeros(6), np.eye(3)), PathGoal(self._home, 0)

    def turn(self, draw: np.random.Generator, stick: float, i: int) -> None:
        """Ask for something else: a twist of at most `stick`, and another goal."""
        home = self._home
        self.command = StickCommand(stick * draw.uniform(-1.0, 1.0, 6), np.eye(3))
        self.goal = PathGoal(Pose(home.R, home.p + draw.uniform(-0.1, 0.1, 3)), i)


def _measure(cell: Cell, ticks: int, stick: float, paused: bool = True) -> _Phase:
    control = Control.of(cell)
    world = ObstacleMap.from_cell(cell, Events())
    draw = np.random.default_rng(1)
    ready = [np.array(part.config.mechanism.postures["ready"]) for part in cell.parts]
    memory = control.seed(np.concatenate(ready))
    leads = {task.by[0]: joint_part(cell, task) for task in cell.joint_tasks if task.at_start}
    led = [leads.get(part.config.mechanism.name, part) for part in cell.parts]
    operators = [_Operator(part, q) for part, q in zip(led, ready, strict=True)]
    seconds: list[float] = []
    pace: list[float] = []
    limited = 0
    gc.collect()
    gc.disable()
    try:
        for i in range(WARM_UP + ticks):
            for operator in operators if i % TURN_EVERY == 0 else ():
                operator.turn(draw, stick, i)
            scene = world.scene(i) if world.known else None
            inputs = [
                Inputs(
                    time_s=i * cell.config.timing.period_s,
                    intent=Intent.MOVE,
                    q_measured=memory.commanded.sent[1][part],
                    settings=operator.settings,
                    wrench_sensor=draw.normal(0.0, 1.0, 6),
                    stick=operator.command,
                    goal=operator.goal,
                    view=ViewGoal(Pose.identity(), operator.goal.T_world_target),
                    scene=scene,
                )
                for operator, part in zip(operators, control.parts, strict=True)
            ]
            start = time.perf_counter()
            memory, outputs = control.tick(memory, inputs)
            seconds.append(time.perf_counter() - start)
            if paused and i % ARITHMETIC_EVERY == 0:
                start = time.perf_counter()
                arithmetic()
                pace.append(time.perf_counter() - start)
            if paused:
                time.sleep(PAUSE_S)
            elif i % REST_EVERY == 0:
                time.sleep(REST_S)
            limited += any(output.limits for output in outputs) and i >= WARM_UP
    finally:
        gc.enable()
    return _Phase(seconds[WARM_UP:], pace, limited)


def settings_of(cell: Cell) -> Settings:
    """Return a cell's settings at start, every source on."""
    config = cell.config
    mrf, crf = config.mechanism.T_wrist_mrf, config.T_world_crf
    gains: dict[str, Array] = {
        name: np.array(section.gain)
        for name, section in config.sources.each.items()
        if section.enabled or name != "following"
    }
    return Settings(
        gains=gains,
        T_wrist_mrf=Pose.from_xyz_rpy(mrf.xyz, mrf.rpy),
        T_world_crf=Pose.from_xyz_rpy(crf.xyz, crf.rpy),
        wrench_bias=np.zeros(6),
        avoid=config.avoidance.enabled,
    )
