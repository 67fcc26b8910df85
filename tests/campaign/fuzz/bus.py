"""Fuzzes a daemon in virtual time with frames of unknown CAN nodes.

A second master and a drive that contradicts itself are told as such and end in FAULT, rightly. But
nothing is raised, and no setpoint leaves its bounds.
"""

import random

from telerobot.config.load import load_cell, shipped
from telerobot.config.schema.mechanism import DriveSection
from telerobot.drivers.bus import CanMessage, InProcessBus
from telerobot.protocols.canopen import can301
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from .blind import Blind
from .outcome import Outcome

SECONDS = 2.0
"""Virtual time of one job, after the enable [s]."""
PER_TICK = 10
"""Frames in a period [1]."""


def play(seed: int) -> Outcome:
    """Run one job in one of the shipped cells."""
    cells = shipped("cells")
    cell = load_cell(cells[seed % len(cells)])
    outcome, dice = Outcome(f"bus, {cell.config.name}", seed), random.Random(f"bus {seed}")
    stick = {"at_s": 0.3, "cmd/joystick": {"twist": [0.0, 0.03, 0.02, 0.0, 0.0, 0.1]}}
    script = Script.model_validate({"duration_s": SECONDS, "step": [stick]})
    simulation = Simulation(cell, script, cameras=Blind)
    stranger = InProcessBus(simulation.buses.hubs[0], lambda _frame: None)
    first_bus = cell.config.fieldbuses[0].name
    on_it = [entry.section for entry in cell.devices if entry.bus == first_bus]
    nodes = [section.node for section in on_it if isinstance(section, DriveSection)]
    masters = {can301.NMT_ID, can301.SYNC_ID, can301.heartbeat_id(can301.MASTER_NODE)}
    masters |= {base(n) for n in nodes for base in (can301.rpdo1_id, can301.sdo_request_id)}
    odd = [
        *(base(n) for n in nodes for base in (can301.tpdo1_id, can301.sdo_reply_id)),
        *(base(n) for n in nodes for base in (can301.emcy_id, can301.heartbeat_id)),
        0x01, 0x02, 0x64, 0x7E4, 0x7E5,
    ]  # fmt: skip
    most = dice.choice((0, 1, PER_TICK))
    """Frames of known nodes end most jobs at once; so do some jobs without."""

    def on_tick(_now: Simulation) -> None:
        for i in range(PER_TICK):
            can_id = dice.choice(odd) if i < most else dice.randrange(0x800)
            if can_id in masters:
                continue
            data = dice.randbytes(dice.choice((8, 8, dice.randrange(9))))
            extended = dice.random() < 0.05
            stranger.send(CanMessage(arbitration_id=can_id, data=data, is_extended_id=extended))
            outcome.inputs["CAN frames"] += 1

    simulation.on_tick = on_tick
    try:
        simulation.run()
    except Exception as error:  # noqa: BLE001  that nothing is raised is what is tried
        outcome.reasons.append(outcome.raised(error, "simulation"))
        return outcome
    outcome.reasons += [
        f"{e.name} at {e.time_s:.2f} s: {e.detail}"
        for e in simulation.events
        if e.name in ("tick_raised", "gate_refused")
    ]
    # What forged drives say of their own motion, or of where they stand, is no setpoint.
    forged = ("measured", "leap")
    sent = [v for v in simulation.observer.violations if not v.kind.startswith(forged)]
    if sent:
        first = sent[0]
        outcome.reasons.append(
            f"{len(sent)} limit violations, the first {first.joint} "
            f"{first.kind} {first.value:.6g} over {first.bound:.6g} at {first.time_s:.3f} s"
        )
    return outcome
