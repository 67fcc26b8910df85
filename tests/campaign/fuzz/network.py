"""Fuzzes a daemon in virtual time with messages of strangers, sensors and the lease's holder.

Strangers send junk on every key and ask for everything; sensor keys get news that is valid, and
wild. An honest operator who drives meanwhile keeps the lease, and nothing is in FAULT. In every
third job it is the operator that goes wild, in the range of what the messages allow; then the arm
may run into something, and only what came of that is excused.
"""

import random
from typing import Any

from telerobot.config.load import Cell, load_cell, shipped
from telerobot.protocols import topics as t
from telerobot.protocols.messages.messages import Message
from telerobot.protocols.topics import Flow
from telerobot.server.mode import Mode
from telerobot.tools.client.protocol_client import ANYBODY, NoLease
from telerobot.tools.scripts.player import Phase
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation
from telerobot.tools.soak.cli import ComputedSights, Touches

from .inputs.stranger import KEPT, Stranger
from .inputs.values import ENVELOPE
from .outcome import Outcome

SECONDS = 4.0
"""Virtual time of one job, after the enable [s]."""
PER_TICK = 6
"""Inputs of a stranger in a period [1]."""
HOLDERS_EVERY = 5
"""Periods between two wild commands of the holder [1]."""


def cell_of(seed: int) -> str:
    """Return the name of the cell that a seed's job runs in: one after the other."""
    cells = shipped("cells")
    return cells[seed % len(cells)]


def play(seed: int, name: str | None = None) -> Outcome:
    """Run one job in the shipped cell of that name, or in that of the seed."""
    cell = load_cell(cell_of(seed) if name is None else name)
    wild = seed % 3 == 2
    outcome = Outcome(f"network, {cell.config.name}, {'holder' if wild else 'stranger'}", seed)
    attacker = Attacker(cell, seed, outcome, wild=wild)
    simulation = Simulation(
        cell, _script(seed, wild=wild), cameras=lambda s: ComputedSights(s, seed)
    )
    touches = Touches(simulation)
    simulation.on_tick = attacker.attack
    try:
        result = simulation.run()
    except Exception as error:  # noqa: BLE001  that nothing is raised is what is tried
        outcome.raised(error, "simulation")
        return outcome
    if result.summary["limit_violations"]:
        first = simulation.observer.violations[0]
        outcome.reasons.append(
            f"{result.summary['limit_violations']} limit violations: {first.joint} {first.kind} "
            f"{first.value:.6g} over {first.bound:.6g} at {first.time_s:.3f} s"
        )
    outcome.reasons += touches.unexplained(excused=wild)
    for event in simulation.events:
        if event.name == "lease_expired" and not wild:
            outcome.reasons.append(f"lease_expired at {event.time_s:.2f} s: {event.detail}")
    if result.summary["failure"] and not wild:
        outcome.reasons.append(f"not played: {result.summary['failure']}")
    return outcome


def _script(seed: int, *, wild: bool) -> Script:
    """Return what the operator does beside the attack: sticks there and back, if he is honest."""
    dice, sticks = random.Random(f"sticks {seed}"), list[dict[str, Any]]()
    for i in range(0 if wild else round(SECONDS)):
        twist = [dice.uniform(-0.1, 0.1) for _ in range(3)] + [dice.uniform(-0.3, 0.3)] * 3
        for k, sense in enumerate((1.0, -1.0)):
            stick = {"twist": [sense * x for x in twist], "expressed_in": "base"}
            sticks.append({"at_s": 0.3 + i + 0.5 * k, "cmd/joystick": stick})
    return Script.model_validate({"duration_s": SECONDS, "step": sticks})


class Attacker:
    """Sends what a stranger draws, tick by tick, and what a wild holder does."""

    def __init__(self, cell: Cell, seed: int, outcome: Outcome, *, wild: bool) -> None:
        self._stranger = Stranger(cell, f"network {seed}")
        self._outcome, self._wild = outcome, wild
        self._ticks = 0

    def attack(self, simulation: Simulation) -> None:
        """Send what this tick brings, once the arm was enabled.

        What comes before, as news of an obstacle that is stale, may rightly forbid the enabling.
        """
        if simulation.player.phase is not Phase.PLAYING:
            return
        self._ticks += 1
        link = simulation.link
        for _ in range(PER_TICK):
            sent = self._stranger.draw(simulation.cycle.tick)
            self._outcome.inputs[f"{sent.topic.flow.name.lower()} of strangers"] += 1
            if sent.topic.flow is Flow.REQUEST:
                link.ask(sent.topic, sent.payload, lambda _reply: None, sent.proof)
            else:
                link.put(*sent)
        if self._wild and self._ticks % HOLDERS_EVERY == 0:
            self._command(simulation)
            self._recover(simulation)

    def _command(self, simulation: Simulation) -> None:
        dice, client = self._stranger.dice, simulation.player.client
        topic = dice.choice((*t.COMMANDS, *t.REQUESTS))
        drawn = self._stranger.values.message(topic.message, **_known(topic.message))
        if drawn is None or topic in KEPT:
            return
        fields = {k: v for k, v in dict(drawn).items() if k not in ENVELOPE}
        try:
            if topic.flow is Flow.REQUEST:
                client.request(topic, lambda _reply: None, **fields)
            elif dice.random() < 0.7 and topic.life is t.Life.STREAM:
                client.stream(topic, **fields)
            else:
                client.command(topic, **fields)
        except NoLease:
            return  # the lease is lost: nobody may command
        self._outcome.inputs[f"{topic.flow.name.lower()} of the holder"] += 1

    def _recover(self, simulation: Simulation) -> None:
        """Take the lease again, enable and go on: a stopped arm tells little."""
        client, mode = simulation.player.client, simulation.cycle.mode
        action = {Mode.READY: "enable", Mode.HOLD: "resume"}.get(mode)
        try:
            client.acquire(lambda _reply: None)
            if mode is not Mode.ENABLED:
                client.clear_protective_stop(lambda _reply: None)
            if action is not None:
                client.request(t.MODE, lambda _reply: None, action=action)
        except NoLease:
            return


def _known(kind: type[Message]) -> dict[str, Any]:
    """Return what stands for a command's envelope while its fields are drawn."""
    return {k: v for k, v in ANYBODY.items() if k in kind.model_fields}
