"""`telerobot identify`: a guided motion, and what it found: a payload, or what the tool touches."""

import argparse
import json
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from ...config.errors import ConfigError, nearest
from ...config.load import Cell
from ...protocols import topics as t
from ...protocols.messages import requests
from ...server.identification.environment import Along, Environment, environment, propose
from ...server.identification.payload import (
    AttitudeMean,
    AttitudeStop,
    Estimate,
    NotIdentified,
    attitudes,
    judge,
)
from ..client.operator import Operator, OperatorError
from ..client.protocol_client import ProtocolClient, ignore
from ..host.address import cell_from
from ..host.progress import say
from ..scripts.player import Phase
from ..scripts.script import Script
from ..simulation.simulation import Simulation
from . import environment as presses
from .environment import Course, GaveUpError, Leader, Press, PressGuide


# --- Report of an identification: for people, for programs, for the cell file ---------------------
def as_dict(cell: Cell, found: Estimate) -> dict[str, object]:
    """Return the estimate as JSON's types."""
    return {
        "cell": cell.config.name,
        "mass": found.mass,
        "com": found.com.tolist(),
        "bias": found.bias.tolist(),
        "mounting_rpy": list(found.rpy()),
        "mounting_known": found.mounting_known,
        "calibration": None if found.calibration is None else found.calibration.tolist(),
        "residual_force": found.residual.force,
        "residual_moment": found.residual.moment,
        "rigid_residual_force": found.rigid_residual.force,
        "rigid_residual_moment": found.rigid_residual.moment,
        "condition": found.condition,
        "attitudes": found.attitudes,
        "toml": snippet(cell, found),
    }


def table(found: Estimate) -> str:
    """Return the estimate, a line each."""
    degrees = [math.degrees(a) for a in found.rpy()]
    mounting = f"rpy {_numbers(degrees, 2)} deg"
    if not found.mounting_known:
        mounting += ", the cell's own: the payload is too light to tell"
    corrected = "needed" if found.calibration is not None else "not needed"
    return "\n".join(
        (
            f"mass            {found.mass:.4f} kg",
            f"centre of mass  {_numbers(found.com, 4)} m, in the Sensor frame",
            f"bias            {_numbers(found.bias, 3)} N, N·m",
            f"mounting        {mounting}",
            f"cross-talk      correction {corrected}",
            f"residual        {found.residual.force:.3f} N, {found.residual.moment:.4f} N·m "
            f"(without correction {found.rigid_residual.force:.3f} N, "
            f"{found.rigid_residual.moment:.4f} N·m)",
            f"condition       {found.condition:.2f} from {found.attitudes} attitudes",
        )
    )


def snippet(cell: Cell, found: Estimate) -> str:
    """Return the lines of `[mechanism.force_torque]` that say what was found.

    Of one of several they are for its own table in `[[mechanisms]]`.
    """
    sensor = cell.config.mechanism.force_torque
    xyz = (0.0, 0.0, 0.0) if sensor is None else sensor.T_wrist_sensor.xyz
    lines = [
        f"[{cell.place.split('[')[0]}.force_torque]",
        f"T_wrist_sensor = {{ xyz = {_numbers(xyz, 6)}, rpy = {_numbers(found.rpy(), 6)} }}",
        f"payload = {{ mass = {found.mass:.5g}, com = {_numbers(found.com, 5)} }}",
        f"bias = {_numbers(found.bias, 4)}",
    ]
    if found.calibration is not None:
        rows = ",\n".join(f"  {_numbers(row, 6)}" for row in found.calibration)
        lines.append(f"calibration = [\n{rows},\n]")
    return "\n".join(lines)


def _numbers(values: Iterable[float], digits: int) -> str:
    numbers = [float(v) for v in values]
    return "[" + ", ".join(f"{round(v, digits) + 0.0:.{digits}f}" for v in numbers) + "]"


# --- The arm of a cell whose sensor is identified -------------------------------------------------
class Subject(NamedTuple):
    """One arm: its part of the cell, and where commands and states have it."""

    part: Cell
    mechanism: str | None  # name for commands; None for the only one
    task: str | None
    joints: slice  # its joints among all of the cell


def subject_of(cell: Cell, mechanism: str | None) -> Subject:
    """Return the mechanism of that name, or the only one. Raises `ConfigError`."""
    parts = cell.parts
    names = [part.config.mechanism.name for part in parts]
    if mechanism is None:
        if len(parts) > 1:
            known = ", ".join(names)
            raise ConfigError(f"{cell.path}: mechanisms: say which: --mechanism, one of {known}")
        return Subject(cell, None, None, slice(None))
    if mechanism not in names:
        hint = nearest(mechanism, names)
        raise ConfigError(f"{cell.path}: mechanisms: '{mechanism}': no such mechanism{hint}")
    i = names.index(mechanism)
    first = sum(len(part.robot.joints) for part in parts[:i])
    joints = slice(first, first + len(parts[i].robot.joints))
    return Subject(parts[i], mechanism, parts[i].task, joints)


# --- Leads an arm through attitudes and averages its sensor in each -------------------------------
SETTLE_S = 0.4  # from arrival until the sensor is believed [s]
AVERAGE_S = 0.6  # the sensor is averaged for this long [s]
ARRIVE_S = 30.0  # a posture that is not reached by then will not be [s]


@dataclass
class Guide(Leader):
    """Goes from stop to stop."""

    stops: list[AttitudeStop]
    joints: slice = field(default_factory=lambda: slice(None))  # its own, among all of the cell
    samples: list[AttitudeMean] = field(default_factory=list)
    _allowed: bool = False

    def _course(self) -> Course:
        # Its weight is no contact to force control, and no push to collision detection.
        self.client.request(t.PAYLOAD, self._on_told, unknown=True, mechanism=self.mechanism)
        yield
        while not self._allowed:
            yield
        for i, stop in enumerate(self.stops):
            if i > 0:
                yield
            self._to(q=tuple(stop.q.tolist()))
            if not (yield from self._arriving(t.POSTURE, ARRIVE_S)):
                raise GaveUpError(f"posture not reached within {ARRIVE_S:g} s")
            if stop.measure:
                yield from self._averaged()

    def _averaged(self) -> Course:
        """Average the sensor at an attitude, once it has settled."""
        arrived_s = self._state.time_s
        heard: list[tuple[tuple[float, ...], tuple[float, ...]]] = []
        while not heard or self._state.time_s < arrived_s + SETTLE_S + AVERAGE_S:
            yield
            if self._state.time_s >= arrived_s + SETTLE_S:
                if self._told.wrench_sensor is None:
                    raise GaveUpError("the force/torque sensor is stale or missing")
                heard.append((self._state.q[self.joints], self._told.wrench_sensor))
        q, wrench = (np.mean(part, axis=0) for part in zip(*heard, strict=True))
        self.samples.append(AttitudeMean(q, wrench))
        wanted = sum(stop.measure for stop in self.stops)
        self.say(f"attitude {len(self.samples)} of {wanted}")

    def _on_told(self, reply: requests.Reply) -> None:
        self._allowed = reply.ok
        if not reply.ok:
            self._end(f"{reply.reason}: {reply.detail}")

    def _end(self, why: str) -> None:
        super()._end(why)
        if self._allowed:
            self.say("force control waits until the payload is told (operator/payload), or a tare")


# --- Identification from the first state to the estimate: on a daemon, or in virtual time ---------
LONGEST_S = 1800.0  # no identification takes longer [s]


L = TypeVar("L", bound=Leader)


def _led(cell: Cell, made: Callable[[ProtocolClient], L], longest_s: float, *, simulate: bool) -> L:
    """Let a leader, made with its client, lead an arm to the end; return it.

    A daemon's, or virtual hardware in virtual time. Raises `NotIdentified` where the simulation
    fails, `OperatorError`.
    """
    if simulate:
        simulation = Simulation(cell, Script(duration_s=LONGEST_S))
        leader = made(simulation.player.client)

        def after_tick(running: Simulation) -> None:
            if running.player.phase is Phase.PLAYING:
                leader.run(running.states[-1])
                if leader.over:
                    running.player.phase = Phase.OVER

        simulation.on_tick = after_tick
        if (failure := simulation.run().summary["failure"]) is not None:
            raise NotIdentified(str(failure))
    else:
        with Operator(cell, name="identify") as operator:
            operator.acquire()
            operator.enable()
            leader = made(operator.client)
            operator.on_state = leader.run
            try:
                operator.spin(longest_s, lambda: leader.over)
            finally:
                operator.on_state = ignore
    return leader


def identify(
    cell: Cell,
    stops: list[AttitudeStop],
    say: Callable[[str], None] = ignore,
    subject: Subject | None = None,
    *,
    simulate: bool,
) -> list[AttitudeMean]:
    """Lead an arm, or the only one, through the stops: a daemon's, or virtual hardware.

    Raises `NotIdentified` where it could not go on, `OperatorError`.
    """
    of = subject or subject_of(cell, None)
    arm = partial(Guide, mechanism=of.mechanism, task=of.task, joints=of.joints)
    made = partial(arm, stops=stops, say=say)
    longest_s = min(LONGEST_S, ARRIVE_S * len(stops))
    return _led(cell, made, longest_s, simulate=simulate).checked().samples


def touch(
    cell: Cell,
    press: Press,
    say: Callable[[str], None] = ignore,
    subject: Subject | None = None,
    *,
    simulate: bool,
) -> Environment:
    """Press the tool of an arm, as `identify` leads it, against what is before it.

    Raises `NotIdentified`, `OperatorError`, or `ConfigError` for a press that the cell does not
    allow.
    """
    of = subject or subject_of(cell, None)
    presses.allowed(of.part, press)
    made = partial(PressGuide, press=press, say=say, mechanism=of.mechanism, task=of.task)
    led = _led(cell, made, LONGEST_S, simulate=simulate).checked()
    return environment(of.part, press.along, led.steady, led.way, led.samples)


# --- `telerobot identify CELL`: payload, sensor bias, mounting and cross-talk by a guided motion;
# with `--environment` stiffness and delay of what the tool touches
def run(args: argparse.Namespace) -> int:
    """Identify; print what was found and the lines for the cell. Raises `ConfigError`."""
    cell = cell_from(args)
    subject = subject_of(cell, args.mechanism)
    try:
        told = (_environment if args.environment else _payload)(cell, subject, args)
    except (NotIdentified, OperatorError) as error:
        say(f"telerobot: not identified: {error}")
        return 1
    print(told)
    return 0


def _payload(cell: Cell, subject: Subject, args: argparse.Namespace) -> str:
    part = subject.part
    stops = attitudes(part, args.posture or "ready", args.attitudes, args.room)
    found = judge(part, identify(cell, stops, say, subject, simulate=args.simulate))
    if args.json:
        return json.dumps(as_dict(part, found))
    return f"{table(found)}\n\n{snippet(part, found)}"


def _environment(cell: Cell, subject: Subject, args: argparse.Namespace) -> str:
    along = Along.of(args.along)
    press = Press(along, args.way, args.force, args.posture)
    found = touch(cell, press, say, subject, simulate=args.simulate)
    gains = propose(subject.part, found, along)
    if args.json:
        return json.dumps(presses.as_dict(subject.part, found, gains))
    return presses.report(subject.part, found, gains)
