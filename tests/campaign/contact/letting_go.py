"""Contact without a sensor's sight, and its release: judged by the physics.

A part of the arm meets a sprung plate that nobody told of. After the stop the arm must give way:
from `WITHIN_S` later on, for `HELD_S`, the force between them is below `GENTLE_N` at every physics
step. Then it is resumed and moves away, and touches nothing any more.

Tried are forearm, elbow and wrist on walls of 2 and 200 kN/m in every operation mode, with and
without a force/torque sensor; postures, motions and walls drawn from seeds; and a wrist that force
control presses on a table, since the payload is 5 kg heavier than the daemon knows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product, takewhile
from typing import NamedTuple

import numpy as np
from telerobot.config.load import Cell, altered, load_cell
from telerobot.config.schema.rig import WallSection
from telerobot.drivers.rig.physics.world import Vector, World
from telerobot.protocols.messages.telemetry import State
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

CELL = "pa10"
GENTLE_N = 60.0
WITHIN_S, HELD_S = 1.0, 10.0
HIT_S = 1.0
"""The plate is met after so much jogging [s]."""
SEARCH_S = 2.7
"""The arm is told to go on for so long [s]."""
AWAY_S = 1.2
"""Length of the motion away at the end [s]."""
PLATE = 0.05
"""Half the side of the plate [m]."""
CLEAR = 0.01
"""A drawn arm begins at least so far from the plate [m]."""
BEHIND_S = (0.0, 0.4, 0.8)
"""And is as far from it where it comes on its way away, beyond where it began [s]."""
SAID_S = 1.0
"""Time at which an operator acknowledges the undeclared load [s]."""
LOAD_KG, LOAD_AT = 5.0, (0.0, 0.0, 0.1)
"""The payload that the daemon does not know of, in the Sensor frame [kg, m]."""
ABOVE = 0.04
"""The laden wrist begins so far above the table [m]."""

PARTS: dict[str, tuple[str, tuple[float, float, float], float]] = {
    "forearm": ("link5", (0.0, 0.0, -0.14), 0.05),
    "elbow": ("link3", (0.0, 0.0, 0.0), 0.065),
    "wrist": ("link5", (0.0, 0.0, 0.0), 0.05),
}
"""Link, a point in it [m] and the radius around it [m]."""
MOTIONS = (("forearm", 0, 0.1), ("elbow", 1, -0.1), ("elbow", 0, 0.1), ("wrist", 3, 0.1))
"""Part, jogged joint and its rate [rad/s]."""
STIFFNESSES = (2e3, 2e5)
MODES = ("csp", "csv", "cst")
LOW = np.array([-1.5, -0.6, -1.0, 0.8, -1.5, -1.0, -1.5])
HIGH = np.array([1.5, 0.9, 1.0, 2.1, 1.5, 1.0, 1.5])
"""Drawn postures [rad]."""
MOVING = {"forearm": 4, "elbow": 2, "wrist": 4}
"""Joints that move the part [1]."""


class ContactPlan(NamedTuple):
    """One contact."""

    name: str
    cell: Cell
    rates: tuple[float, ...] | None
    """Joint rates that lead to the plate [rad/s]; None: a stick or force control does."""
    twist: tuple[float, ...] | None = None
    """Rate that the stick asks for instead (6,), in Base [m/s, rad/s]."""
    begun_s: float = 0.3
    """When that begins, from the script's start [s]."""
    said: str = ""
    """Event that has to be told before the touch."""

    @property
    def driven(self) -> bool:
        """True where an operator leads the arm to the plate."""
        return self.rates is not None or self.twist is not None


@dataclass(frozen=True)
class LetGo:
    """Result of one contact."""

    name: str
    touched_s: float | None
    """Time of detection, from the script's start [s]."""
    peak_n: float
    """Greatest force at all [N]."""
    pressed_n: float
    """Greatest force from `WITHIN_S` after the stop on [N]."""
    gave_way_rad: float
    """How far a joint's command ended from where it was when contact was felt [rad]."""
    reasons: list[str] = field(default_factory=list)


TABLE = tuple(product(range(len(MOTIONS)), STIFFNESSES, MODES, (True, False)))
"""Motion, wall [N/m], operation mode, with a force/torque sensor."""
LADEN = tuple(product(STIFFNESSES, MODES))
"""Wall [N/m] and operation mode of the laden wrist."""


def listed(number: int) -> ContactPlan:
    """Return a contact of the table."""
    motion, stiffness, mode, sensed = TABLE[number]
    part, joint, rate = MOTIONS[motion]
    cell = load_cell(CELL)
    start = np.array(cell.config.mechanism.postures["ready"])
    rates = np.zeros(len(start))
    rates[joint] = rate
    cell = prepared(cell, start, mode, sensed)
    cell = met(cell, start, rates, part, stiffness)
    jogged, sensor = cell.robot.joints[joint].name, "" if sensed else ", no sensor"
    name = f"{part} by {jogged} {stiffness / 1e3:g} kN/m {mode}{sensor}"
    return ContactPlan(name, cell, tuple(rates.tolist()))


def drawn(seed: int) -> ContactPlan:
    """Return a contact with posture, motion, wall and operation mode from a seed."""
    draw = np.random.default_rng(seed)
    while True:
        part = str(draw.choice(list(PARTS)))
        start, size = draw.uniform(LOW, HIGH), np.exp(draw.uniform(np.log(0.02), np.log(0.4)))
        way = np.zeros(len(start))
        if draw.random() < 0.5:
            way[draw.integers(MOVING[part])] = draw.choice([-1.0, 1.0])
        else:
            way = draw.uniform(-1.0, 1.0, len(start))
        rates = np.round(way / np.abs(way).max() * size, 4)
        stiffness = float(np.exp(draw.uniform(*np.log(STIFFNESSES))))
        mode, sensed = str(draw.choice(MODES)), bool(draw.random() < 0.5)
        cell = prepared(load_cell(CELL), start, mode, sensed)
        cell = met(cell, start, rates, part, stiffness)
        if all(_clear(_standing(cell, start - back_s * rates)) for back_s in BEHIND_S):
            return ContactPlan(f"drawn {seed}", cell, tuple(rates.tolist()))


def laden(number: int) -> ContactPlan:
    """Return a wrist above a table, with a payload that nobody told of."""
    stiffness, mode = LADEN[number]
    cell = load_cell(CELL)
    start = np.array(cell.config.mechanism.postures["ready"])
    cell = prepared(cell, start, mode, sensed=True)
    down = np.array([0.0, 0.0, -1.0])
    at = _place(cell, start, "wrist") + (PARTS["wrist"][2] + ABOVE) * down
    cell = surrounded(
        cell, wall=plate(at, down, stiffness), payload_mass=LOAD_KG, payload_com=LOAD_AT
    )
    return ContactPlan(f"laden wrist {stiffness / 1e3:g} kN/m {mode}", cell, None)


def play(plan: ContactPlan, held_s: float = HELD_S, hold_s: float | None = None) -> LetGo:
    """Simulate a contact, and `held_s` of HOLD, and judge it; at `hold_s` HOLD is asked for, too.

    All in seconds.
    """
    resumed_s = plan.begun_s + HIT_S + 0.7 + WITHIN_S + held_s
    simulation = Simulation(plan.cell, _script(plan, resumed_s, hold_s))
    times: list[float] = []
    forces: list[float] = []

    def look(of: Simulation) -> None:
        times.append(of.rig.time_s)
        forces.append(of.rig.world.contacts.total(0))

    simulation.on_physics = look
    result = simulation.run()
    t, force = np.array(times) - simulation.player.start_s, np.array(forces)
    events = {name: [e for e in simulation.events if e.name == name] for name in _TOLD}
    felt = [e.time_s - simulation.player.start_s for e in events["touched"]]
    # The rest of HOLD is judged: what a laden wrist does when it is resumed is another touch.
    stopped_s = felt[0] if felt else 0.0
    pressed = force[(t > stopped_s + WITHIN_S) & (t < resumed_s)].max()
    held = [np.array(s.q_command) for s in result.states if s.mode == "hold"]
    met = [np.array(s.q_command) for s in takewhile(_before_the_stop, result.states)]
    travel = float(np.abs(held[-1] - met[-1]).max()) if held and met else 0.0
    reasons = []
    if not felt:
        reasons.append("not felt")
    if not pressed < GENTLE_N:
        reasons.append(f"pressed with {pressed:.0f} N after the stop")
    if plan.said and not any(e.name == plan.said for e in simulation.events):
        reasons.append(f"{plan.said} was not told")
    if felt and not events["gave_way"]:
        reasons.append("the arm did not tell that it gave way")
    touch = plan.cell.config.touch
    if plan.driven:
        if touch is not None and travel > touch.leash:
            reasons.append(f"gave way by {travel:.3f} rad")
        if result.summary["mode"] != "enabled" or len(felt) > 1:
            reasons.append(f"told to move away, it is in {result.summary['mode']}")
        if force[-1] > 0.0:
            reasons.append(f"still pressed with {force[-1]:.0f} N after moving away")
    if events["request_refused"]:
        reasons.append("resume was refused")
    if result.summary["limit_violations"]:
        reasons.append(f"{result.summary['limit_violations']} limit violations")
    after = round(felt[0], 3) if felt else None
    return LetGo(plan.name, after, float(force.max()), float(pressed), travel, reasons)


def lines(runs: Sequence[LetGo]) -> list[str]:
    """Return the report: a line for each contact."""
    return [
        f"  {run.name:46s} felt at {run.touched_s} s, at most {run.peak_n:4.0f} N, "
        f"{WITHIN_S:g} s later {run.pressed_n:3.0f} N, gave way by {run.gave_way_rad:.4f} rad"
        for run in runs
    ]


def _before_the_stop(state: State) -> bool:
    return state.mode != "stopping"


_TOLD = ("touched", "gave_way", "request_refused")


def _script(plan: ContactPlan, resumed_s: float, hold_s: float | None) -> Script:
    steps: list[dict[str, object]] = [{"at_s": resumed_s, "operator/mode": {"action": "resume"}}]
    if hold_s is not None:
        steps.append({"at_s": hold_s, "operator/mode": {"action": "hold"}})
    if not plan.driven:
        # Said to be unexplained, force control would not act on it.
        steps.append({"at_s": SAID_S, "operator/acknowledge_load": {}})
    else:
        topic = "cmd/joystick" if plan.rates is None else "cmd/jog"
        steps += [
            {"at_s": plan.begun_s, topic: _asked(plan, 1.0)},
            {"at_s": plan.begun_s + SEARCH_S, "silence": [topic]},
            {"at_s": resumed_s + 0.1, topic: _asked(plan, -1.0)},
        ]
    seconds = resumed_s + (AWAY_S if plan.driven else 0.1)
    return Script.model_validate({"duration_s": seconds, "step": steps})


def _asked(plan: ContactPlan, share: float) -> dict[str, object]:
    """Return the message that leads to the plate, or with −1 away from it."""
    if plan.rates is not None:
        return {"rates": [share * rate for rate in plan.rates]}
    return {"twist": [share * x for x in plan.twist or ()], "expressed_in": "base"}


def prepared(cell: Cell, start: Vector, mode: str, sensed: bool) -> Cell:
    """Return the cell with another start, operation mode and sensor, and nothing around it.

    Its joints are jogged as quickly as is asked: what the tool's own bound takes off is no touch.
    """
    changes = {"mechanism.operation_mode": mode, "limits.jog_speed": 10.0}
    cell = altered(_standing(cell, start), changes)
    if not sensed:
        cell = altered(cell, {"mechanism.force_torque": None})
    return surrounded(cell, wall=None, boxes=())


def surrounded(cell: Cell, **changes: object) -> Cell:
    """Return the cell with changes of its `[rig]`."""
    if cell.config.rig is None:
        raise ValueError(f"cell {cell.config.name}: needs a rig")
    return altered(cell, changes, "rig")


def met(cell: Cell, start: Vector, rates: Vector, part: str, stiffness: float) -> Cell:
    """Return the cell with a plate that a part of the arm runs into after `HIT_S`, head-on."""
    q, small = start + HIT_S * rates, 1e-4
    at, before = (_place(cell, q - back * rates, part) for back in (0.0, small))
    way = (at - before) / np.linalg.norm(at - before)
    return surrounded(cell, wall=plate(at + PARTS[part][2] * way, way, stiffness))


def plate(at: Vector, way: Vector, stiffness: float, half_size: float = PLATE) -> WallSection:
    """Return a sprung plate at a place (3,) [m] across a way (3,), of so many N/m."""
    x, y, z = at.tolist()
    a, b, c = (-way).tolist()
    return WallSection(xyz=(x, y, z), normal=(a, b, c), half_size=half_size, stiffness=stiffness)


def _place(cell: Cell, q: Vector, part: str) -> Vector:
    """Return where a part of the arm is in World (3,) [m] with the joints at q (n,)."""
    link, point, _ = PARTS[part]
    body = World(_standing(cell, q)).data.body(link)
    place: Vector = body.xpos + body.xmat.reshape(3, 3) @ np.array(point)
    return place


def _standing(cell: Cell, q: Vector) -> Cell:
    """Return the cell with joints that start at q (n,) [rad]."""
    return altered(cell, {"mechanism.postures.start": tuple(q.tolist())})


def _clear(cell: Cell) -> bool:
    return (World(cell).distances.clearance() or 0.0) > CLEAR
