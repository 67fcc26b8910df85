"""Part `touch`: pushes that no sensor sees are felt; ordinary motion and contact are no push.

Free motion with 2 kg more on the tool, of which the daemon knows: smooth sticks there and back,
postures in between, for as long as the seeds last. A tool that slides along wall and table, both as
soft as the cell declares, slowly and quickly, pressed gently and hard, in all directions. A push at
the elbow while it moves, from every side. And contact that the arm runs into, of which it must let
go (`letting_go.py`).
"""

from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from telerobot.config.load import Cell, altered, load_cell
from telerobot.config.schema.mechanism import PayloadSection
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..part import Part, Selection
from ..runs import Runs
from . import doubted, letting_go
from .letting_go import LetGo
from .sliding import MADE_S, SLIDES, as_declared, sliding

CELL = "pa10"
MASS, COM = 2.0, (0.0, 0.0, 0.10)
"""Mass added to the tool [kg], and its centre in the Sensor frame [m]."""
PUSH_N = 30.0
PUSH_AT_S, NOTICED_WITHIN_S = 2.0, 1.0
ELBOW = "e1"
MOTIONS = ((0.0, 0.05, 0.02, 0.0, 0.0, 0.1), (0.0, -0.08, 0.05, 0.0, 0.0, 0.0))
SIDES = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))

Job = tuple[str, int]
"""`free` and a seed, `push` or `slide` and its number; of contacts `contact`, `laden` or `doubted`
and its number, or `drawn` and a seed."""
CONTACTS = {
    "contact": letting_go.listed,
    "laden": letting_go.laden,
    "doubted": doubted.doubted,
    "drawn": letting_go.drawn,
}


@dataclass(frozen=True)
class TouchRun:
    """Result of one run."""

    name: str
    kind: str
    moving_s: float
    """Time in which the arm was free to move [s]."""
    touched_after_s: float | None
    """From the push, or from the start, to the event; None: there was none."""
    reasons: list[str] = field(default_factory=list)


class Feeling(Runs[TouchRun | LetGo]):
    """Summary of all runs: pushes were felt in time, nothing else was, contact was let go of."""

    def figures(self) -> dict[str, object]:
        """Return everything as plain values."""
        motions = [run for run in self.runs if isinstance(run, TouchRun)]
        pushes = [run for run in motions if run.kind == "push"]
        felt = [run.touched_after_s for run in pushes if run.touched_after_s is not None]
        free = [run for run in motions if run.kind == "free"]
        slides = [run for run in motions if run.kind == "slide"]
        contacts = self._contacts()
        return super().figures() | {
            "contacts": len(contacts),
            "let_go": sum(not run.reasons for run in contacts),
            "pressed_n": round(max((run.pressed_n for run in contacts), default=0.0), 1),
            "pushes": len(pushes),
            "felt": len(felt),
            "felt_within_s": max(felt, default=None),
            "free_s": round(sum(run.moving_s for run in free), 1),
            "false_alarms": sum(run.touched_after_s is not None for run in free),
            "slides": len(slides),
            "slides_taken_for_a_push": sum(run.touched_after_s is not None for run in slides),
        }

    def lines(self) -> list[str]:
        """Return the report."""
        f = self.figures()
        return [
            f"pushes of {PUSH_N:g} N at the elbow felt: {f['felt']} of {f['pushes']}, "
            f"the latest after {f['felt_within_s']} s",
            f"free motion with {MASS:g} kg more: {f['free_s']} s, "
            f"{f['false_alarms']} taken for a push",
            f"slides along wall and table: {f['slides']}, "
            f"{f['slides_taken_for_a_push']} taken for a push",
            f"contact let go of: {f['let_go']} of {f['contacts']}, pressed with at most "
            f"{f['pressed_n']} N from {letting_go.WITHIN_S:g} s after the stop on",
            *letting_go.lines(self._contacts()),
            *super().lines(),
        ]

    def _contacts(self) -> list[LetGo]:
        return [run for run in self.runs if isinstance(run, LetGo)]


def laden(cell: Cell) -> Cell:
    """Return the cell with more on its tool, of which the daemon knows, and nothing to run into."""
    config = cell.config
    sensor, rig = config.mechanism.force_torque, config.rig
    if sensor is None or rig is None:
        raise ValueError(f"cell {config.name}: needs a force/torque sensor and a rig")
    own = sensor.payload
    mass = own.mass + MASS
    x, y, z = ((own.mass * a + MASS * b) / mass for a, b in zip(own.com, COM, strict=True))
    payload = PayloadSection(mass=mass, com=(x, y, z))
    bare = {"wall": None, "boxes": (), "payload_mass": MASS, "payload_com": COM}
    return altered(altered(cell, {"mechanism.force_torque.payload": payload}), bare, "rig")


def free_motion(seed: int) -> Script:
    """Return half a minute of sticks there and back, with a posture now and then."""
    draw = np.random.default_rng(seed)
    steps: list[dict[str, Any]] = []
    at_s = 0.3
    for leg in range(12):
        size = np.array([0.15, 0.15, 0.15, 0.4, 0.4, 0.4]) * draw.uniform(0.2, 1.0)
        twist = np.round(draw.uniform(-1.0, 1.0, 6) * size, 3)
        for sense in (1.0, -1.0):
            stick = {"twist": (sense * twist).tolist(), "expressed_in": "base"}
            steps.append({"at_s": round(at_s, 2), "cmd/joystick": stick})
            at_s += draw.uniform(0.3, 1.2)
        if leg % 4 == 3:
            steps.append({"at_s": round(at_s, 2), "cmd/joystick": {"twist": [0.0] * 6}})
            steps.append({"at_s": round(at_s + 0.5, 2), "cmd/posture": {"posture": "ready"}})
            at_s += 3.0
    return Script.model_validate({"duration_s": round(at_s, 2), "step": steps})


def push(number: int) -> Script:
    """Return a motion with a push at the elbow from one side."""
    twist, side = list(product(MOTIONS, SIDES))[number]
    force = [PUSH_N * component for component in side]
    return Script.model_validate(
        {
            "duration_s": PUSH_AT_S + 1.5,
            "step": [
                {"at_s": 0.3, "cmd/joystick": {"twist": twist, "expressed_in": "base"}},
                {
                    "at_s": PUSH_AT_S,
                    "rig/fault": {"kind": "push", "target": ELBOW, "vector": force},
                },
            ],
        }
    )


def play(job: Job) -> TouchRun | LetGo:
    """Simulate one job and judge it."""
    kind, number = job
    return letting_go.play(CONTACTS[kind](number)) if kind in CONTACTS else feel(job)


def feel(job: Job) -> TouchRun:
    """Simulate a push, or free motion, and judge it."""
    kind, number = job
    pushed = kind == "push"
    cell, name = load_cell(CELL), f"{kind} {number}"
    match kind:
        case "push":
            script = push(number)
        case "slide":
            slide = SLIDES[number]
            cell = as_declared(cell) if slide.surface == "table" else cell
            script, name = sliding(cell, slide), f"slide {slide}"
        case _:
            cell, script = laden(cell), free_motion(number)
    simulation = Simulation(cell, script)
    result = simulation.run()
    start = simulation.player.start_s + (PUSH_AT_S if pushed else 0.0)
    felt = [e.time_s - start for e in simulation.events if e.name == "touched"]
    after = round(felt[0], 3) if felt else None
    reasons = []
    if pushed and (after is None or not 0.0 <= after <= NOTICED_WITHIN_S):
        reasons.append(f"felt after {after} s, not within {NOTICED_WITHIN_S:g}")
    if pushed and result.summary["mode"] != "hold":
        reasons.append(f"the arm is in {result.summary['mode']}, not in hold")
    if not pushed and after is not None:
        reasons.append(f"taken for a push at {after} s")
    if kind == "slide":
        late = [t for t in result.truths if t.time_s > start + MADE_S]
        if not any(any(t.contact_force) for t in late):
            reasons.append("nothing was touched")
    if result.summary["limit_violations"]:
        reasons.append(f"{result.summary['limit_violations']} limit violations")
    moving = sum(state.mode == "enabled" for state in result.states)
    return TouchRun(name, kind, moving * cell.config.timing.period_s, after, reasons)


def jobs(selection: Selection) -> list[Job]:
    """Return every push, slide and contact, and what is drawn.

    Free motion for two seeds in five, 100 make about 1100 s; a contact for each of the others.
    """
    counts = {
        "push": len(MOTIONS) * len(SIDES),
        "slide": len(SLIDES),
        "contact": len(letting_go.TABLE),
        "laden": len(letting_go.LADEN),
        "doubted": len(doubted.TABLE),
    }
    made = [(kind, number) for kind, count in counts.items() for number in range(count)]
    return made + [("free" if seed % 5 < 2 else "drawn", seed) for seed in selection.seeds]


TOUCH = Part(jobs, play, Feeling)
