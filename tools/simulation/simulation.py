"""Daemon and virtual hardware in one process, in virtual time."""

import hashlib
import itertools
import math
import struct
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ...config.load import Cell, ConfigError, load_cell
from ...drivers.bus import Frame
from ...drivers.device import DeviceError
from ...drivers.fieldbus import VirtualBuses
from ...drivers.rig.cameras import RenderedCameras, SimulatedCameras
from ...drivers.rig.rig import Rig
from ...protocols import topics as t
from ...protocols.codec import encode
from ...protocols.messages import messages as m
from ...protocols.messages.messages import Reflection
from ...protocols.messages.perception import ObstacleNews
from ...protocols.messages.rig import RigTruth
from ...protocols.messages.telemetry import Event, State
from ...server.daemon import build
from ...server.operators.link import MemoryLink
from ...server.process import VirtualClock
from ...server.recorder import BlackBox
from ..recording.recorder import Recorder
from ..scripts.player import Phase, Player
from ..scripts.script import Expected, Script, Step, load_script
from .frame_sensors import SimulatedFrameSensors
from .judges import (
    ToolJudge,
    TunnelJudge,
    ViewJudge,
    base_figures,
    beam_figures,
    peg_depths,
    posture_figures,
)
from .observer import Observer
from .scans import SimulatedScans

# --- Result of a simulation, and the figures of its JSON ------------------------------------------
CONTACT_S = 1.0  # the contact force is the mean over this long before the end [s]


@dataclass(frozen=True)
class Result:
    """Outcome of a simulation: the fields of its JSON, and the state of every tick."""

    summary: dict[str, object]
    states: tuple[State, ...]
    truths: tuple[RigTruth, ...]  # the physics' truth after every tick
    expected: tuple[Expected, ...] = ()  # what the script was to reach, beside what was found

    @property
    def ok(self) -> bool:
        """True when the script was played, met what it expects, and no limit was violated."""
        return (
            self.summary["failure"] is None
            and self.summary["limit_violations"] == 0
            and all(row.met for row in self.expected)
        )


def least(values: Iterable[float | None]) -> float | None:
    """Return the least of those that are there; None for none."""
    return min((value for value in values if value is not None), default=None)


def contact_force(truths: Sequence[RigTruth], period_s: float) -> float:
    """Return the mean contact force of the last `CONTACT_S`, of the arm that presses most [N]."""
    late = truths[-round(CONTACT_S / period_s) :]
    names = late[0].arms if late else ()
    sums = [math.fsum(truth.arms[name].contact_sum for truth in late) for name in names]
    return max(sums, default=0.0) / max(len(late), 1)


def _record(recorder: Recorder, bus: int, frame: Frame) -> None:
    can_id, data, time_s = frame
    recorder.frame(time_s, can_id, data, sent=False, bus=bus)


# --- Keys for simulations, equal in equal runs. Real ones come from `protocols.agreement` ---------
def seeded_keys(owner: str) -> Callable[[], bytes]:
    """Return a source of 32 bytes at a time, the same in every run."""
    numbers = itertools.count(1)
    return lambda: hashlib.sha256(f"{owner} {next(numbers)}".encode()).digest()


# --- Daemon logic and rig in one process, in virtual time: deterministic, faster than real time ---
#
# The same CAN frames go over an in-process bus, and the script's operator goes through the same
# codec, lease and mailboxes as a real one; only the network and the wall clock are missing, and
# telemetry is handed over as the message that it is.
ENABLE_WITHIN_S = 10.0  # a script whose arm is not enabled by then has failed [s]


class Simulation:
    """One run of a cell under a script; `cameras` takes the place of the rendered ones.

    `real` is the cell as it truly stands there, where the daemon is told another.
    """

    def __init__(
        self,
        cell: Cell,
        script: Script,
        record: Path | None = None,
        cameras: "Callable[[Simulation], SimulatedCameras] | None" = None,
        box: BlackBox | None = None,
        real: Cell | None = None,
    ) -> None:
        if cell.config.rig is None:
            raise ConfigError(f"{cell.path}: rig: missing: there is nothing to simulate")
        self._recorder = None if record is None else Recorder(record)
        if self._recorder is not None:
            self._recorder.about(cell, script=script.description)
        self.cell = cell
        self.clock = VirtualClock()
        self.buses = VirtualBuses(cell, self.clock.now, self._pump)
        self.real = cell if real is None else real
        self.rig = Rig(self.real, *self.buses.of_rig)
        self.buses.listen(lambda bus, frame: self.observer.frame(frame[2], frame[0], frame[1], bus))
        if self._recorder is not None:
            self.buses.listen(partial(_record, self._recorder))
        self.link = MemoryLink()
        daemon = seeded_keys("daemon")
        self.cycle = build(cell, self.buses.of_daemon, self.link, self.clock, daemon, box)
        if self._recorder is not None:
            self.cycle.flight.log.taps.append(self._recorder.tick)
        self.player = Player(
            script,
            cell.config.name,
            self.link.put,
            self.link.ask,
            self.rig.inject,
            cell.config.reflection,
            seeded_keys("operators"),
        )
        self.observer = Observer(cell)
        self.view = ViewJudge(cell)
        self._tools = tuple(
            ToolJudge(part, first=i == 0, under=cell.parts[under] if under >= 0 else None)
            for i, (part, under) in enumerate(zip(cell.parts, cell.carriers, strict=True))
        )
        self.player.on_step = self._on_step
        self._tunnel = TunnelJudge(cell)
        self.blind: str | None = None
        """Reason for missing pictures; None where there are pictures or no cameras."""
        self._cameras = self._open_cameras() if cameras is None else cameras(self)
        self.frame_sensors = SimulatedFrameSensors(
            cell, self.rig, lambda news: self.link.put(t.FRAME_NEWS, encode(news))
        )
        self.scans = None
        if cell.config.scanner is not None and cell.config.contour is not None:
            self.scans = SimulatedScans(cell, self.rig, self.link.put, self._recorder)
        self.events: list[Event] = []
        self.states: list[State] = []
        self.truths: list[RigTruth] = []
        self.on_tick: Callable[[Simulation], None] | None = None
        """Called after every tick, for a judge that looks deeper."""
        self.on_physics: Callable[[Simulation], None] | None = None
        """Called after every physics step, for one that must not miss a spike."""
        self._hash = hashlib.sha256()
        self._compute: list[float] = []
        self.buses.listen_to_daemon(self._on_sent)
        self.link.listen(self._on_telemetry)

    def run(self, until: Callable[[], bool] | None = None) -> Result:
        """Play the script to its end, or until that is so; return what it showed."""
        try:
            self.cycle.boot()
            while not self.player.over:
                self.step()
                waiting = self.player.phase is not Phase.PLAYING
                late = waiting and self.clock.time_s > ENABLE_WITHIN_S
                if late or (until is not None and until()):
                    break
            return self._result()
        finally:
            self.close()

    def close(self) -> None:
        self.cycle.close()
        self.buses.close()
        for each in (self._cameras, self._recorder):
            if each is not None:
                each.close()

    def step(self) -> None:
        """Advance one period."""
        self._tell_time()
        self.player.run(self.clock.time_s)
        if self._cameras is not None:
            self._cameras.run(self.clock.time_s, self.cycle.tick + 1)
        self.frame_sensors.run(self.clock.time_s, self.cycle.tick + 1)
        if self.scans is not None:
            self.scans.run(self.clock.time_s)
        self.cycle.gather()
        self.cycle.begin()
        self.rig.poll()
        self.cycle.finish()
        self._compute.append(self.cycle.compute_s)
        for _ in range(round(self.cell.config.timing.period_s / self.rig.dt)):
            for hub in self.buses.hubs:
                hub.time_s = self.rig.time_s + self.rig.dt  # nodes send at a step's end
            self.rig.step()
            if self.on_physics is not None:
                self.on_physics(self)
        self._judge()
        if self.on_tick is not None:
            self.on_tick(self)

    def _open_cameras(self) -> SimulatedCameras | None:
        """Return the cell's rendered cameras; none where it has none, or they cannot be had."""
        if not any(c.device is None for c in self.cell.cameras):
            return None
        try:
            return RenderedCameras(self.cell, self.rig, self.link.put)
        except DeviceError as error:
            self.blind = str(error)
            print(f"telerobot: no pictures: {error}", file=sys.stderr)
            return None

    def _pump(self, done: Callable[[], bool], steps: int) -> None:
        """Let virtual time pass until the daemon hears what it waits for."""
        for _ in range(steps):
            if done():
                return
            self.rig.poll()
            if not done():
                self.rig.step()
            self._tell_time()

    def _tell_time(self) -> None:
        self.clock.time_s = self.rig.time_s
        self.buses.set_time(self.rig.time_s)

    # --- listening ---------------------------------------------------------------------------

    def _on_sent(self, bus: int, can_id: int, data: bytes) -> None:
        self._hash.update(struct.pack("<HB", bus << 11 | can_id, len(data)) + data)

    def _on_telemetry(self, _topic: t.Topic, message: m.Message) -> None:
        if isinstance(message, State):
            self.states.append(message)
            self.player.operators.on_state(message)
            if self.scans is not None:
                self.scans.on_state(message)
            self._write("state", message)
        elif isinstance(message, Reflection):
            self.player.operators.on_reflection(message)
            self._write("reflection", message)
        elif isinstance(message, ObstacleNews):
            self._write("obstacle", message)
        elif isinstance(message, Event):
            self.events.append(message)
            if message.name in ("view_stored", "view_kept"):
                self.view.on_event(message, self.rig.truth())
            self._write("event", message)

    def _write(self, topic: str, message: m.Message) -> None:
        if self._recorder is not None:
            self._recorder.message(topic, self.clock.time_s, message)

    # --- judging -----------------------------------------------------------------------------

    def _judge(self) -> None:
        self.truths.append(truth := self.rig.truth())
        self._write("truth", truth)
        self._tunnel.judge(truth)
        for judge in self._tools:
            judge.judge(truth)

    def _on_step(self, step: Step) -> None:
        truth = self.rig.truth()
        for judge in self._tools:
            judge.on_step(step, truth)

    def _result(self) -> Result:
        period = self.cell.config.timing.period_s
        view = (self.view.error(self.truths[-1]) if self.truths else None) or (None, None)
        tools = [error for judge in self._tools if (error := judge.error) is not None]
        tool = [max(each) for each in zip(*tools, strict=True)] or [None, None]
        enabled = self.player.phase in (Phase.OVER, Phase.PLAYING)
        failure = self.player.failure or (None if enabled else "the arm was not enabled")
        if failure is None and self.blind is not None:
            failure = f"simulated without its cameras: {self.blind}"
        micros = np.array(self._compute or [0.0]) * 1e6
        quantiles = {"p50": 50, "p99": 99, "max": 100}
        summary: dict[str, object] = {
            "cell": self.cell.config.name,
            "failure": failure,
            "ticks": self.cycle.tick,
            "duration_s": round(self.clock.time_s + period, 9),
            "mode": str(self.cycle.mode),
            "events": [
                {"t_s": e.time_s, "name": e.name, "severity": e.severity, "detail": e.detail}
                | ({"values": e.values} if e.values else {})
                for e in self.events
            ],
            "refused": self.player.refused,
            "limit_violations": len(self.observer.violations),
            "violations": [v.__dict__ for v in self.observer.violations[:20]],
            "limited_ticks": sum(bool(s.limits) for s in self.states),
            "min_clearance_m": least(truth.clearance_m for truth in self.truths),
            "min_between_arms_m": least(truth.between_arms_m for truth in self.truths),
            "min_sight_m": least(
                d for truth in self.truths for of in truth.sight.values() for d in of.values()
            ),
            "max_speed_ratio": self.observer.max_speed_ratio,
            "max_acceleration_ratio": self.observer.max_acceleration_ratio,
            "tool_error_m": tool[0],
            "tool_error_rad": tool[1],
            "view_error_m": view[0],
            "view_error_rad": view[1],
            "view_error_px": self.view.error_px(self.truths[-1]) if self.truths else None,
            **self._tunnel.figures(),
            "contact_force_n": contact_force(self.truths, period),
            "contact_peak_n": max(
                (arm.contact_peak for truth in self.truths for arm in truth.arms.values()),
                default=0.0,
            ),
            "own_contact_n": max((truth.own_contact_peak for truth in self.truths), default=0.0),
            "q_final": list(self.truths[-1].q) if self.truths else [],
            "tick_us": {
                name: round(float(np.percentile(micros, q)), 1) for name, q in quantiles.items()
            },
            "command_hash": self._hash.hexdigest(),
        }
        if self.truths:
            summary |= posture_figures(self.cell, self.player.script, self.truths[-1])
            depths = peg_depths(self.real, self.truths[-1])
            summary |= {"peg_depth_m": depths} if depths else {}
        summary |= beam_figures(self.truths, period)
        summary |= base_figures(self.cell, self.states, self.truths)
        expected = tuple(self.player.script.expect.judge(summary))
        summary["expected"] = [row._asdict() for row in expected]
        result = Result(summary, tuple(self.states), tuple(self.truths), expected)
        summary["ok"] = result.ok
        return result


def simulate(
    cell: Cell | str | Path,
    script: Script | str | Path | None = None,
    record: Path | None = None,
    on_tick: Callable[[Simulation], None] | None = None,
) -> Result:
    """Simulate a cell under a script (the cell's own by default).

    `on_tick` is called after every tick. Raises `ConfigError` for a cell or script that is wrong,
    `OSError` for a recording that cannot be written.
    """
    if not isinstance(cell, Cell):
        cell = load_cell(cell)
    if script is None:
        script = cell.default_script
    if not isinstance(script, Script):
        script = load_script(script)
    simulation = Simulation(cell, script, record)
    simulation.on_tick = on_tick
    return simulation.run()
