"""One arm of two that hold a beam fails on the move: a drive, its brakes, its node or its bus.

By physics truth at every physics step, the internal force stays below what the cell allows, at any
speed that is asked for: the payload is slowed down to what a fault would then do. The runs are
forked just before the fault, so that each way of failing costs a few periods alone.
"""

import json
import os
from typing import NamedTuple

import numpy as np
import pytest
from telerobot.config.load import HERE, load_cell
from telerobot.protocols.messages.rig import RigFault
from telerobot.tools.scripts.player import Phase
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

SPEED = 0.25
"""Asked for [m/s]."""

TICKS = 14
"""Periods that are looked at after a fault [1]."""

WAYS = {
    "+x": (1, 0, 0), "-x": (-1, 0, 0), "+y": (0, 1, 0), "-y": (0, -1, 0), "+z": (0, 0, 1),
    "-z": (0, 0, -1),
}  # fmt: skip


class Failed(NamedTuple):
    """What one way of failing did."""

    force: float
    """Greatest internal force at any physics step [N]."""
    mode: str
    drives: tuple[str, ...]


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """The pair without nodes and pegs, which it would meet ahead."""
    text = (HERE / "cells/pa10_pair.toml").read_text()
    text = text[: text.index("# Mouths")]
    text = "\n".join(line for line in text.splitlines() if not line.startswith("pegs"))
    path = tmp_path_factory.mktemp("cell") / "pair.toml"
    path.write_text(text)
    return load_cell(path)


def moving(cell, twist, until_s=0.6):
    """Return a run of the cell that moves its payload by a twist (6,)."""
    stick = {"cmd/joystick": {"twist": twist, "expressed_in": "world"}}
    script = {"duration_s": 5.0, "step": [{"at_s": 0.05, "for_s": 4.0, **stick}]}
    simulation = Simulation(cell, Script.model_validate(script))
    simulation.cycle.boot()
    while simulation.player.phase is not Phase.PLAYING:
        simulation.step()
    while simulation.clock.time_s < simulation.player.start_s + until_s - 1e-9:
        simulation.step()
    return simulation


def failed(simulation, faults, step):
    """Return what faults do at a physics step of the next period, in a process of its own."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            found = _failing(simulation, faults, step)
            os.write(writer, json.dumps(found).encode())
        finally:
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as told:
        words = told.read()
    os.waitpid(child, 0)
    assert words, "the run raised"
    return Failed(*json.loads(words))


def _failing(simulation, faults, step):
    forces, beam = [], simulation.rig.world.beam

    def on_physics(_now):
        forces.append(beam.internal_force())
        if len(forces) == step:
            for fault in faults:
                simulation.rig.inject(fault)

    simulation.on_physics = on_physics
    for _ in range(TICKS):
        simulation.step()
    return max(forces[step:]), str(simulation.cycle.mode), simulation.truths[-1].drives


def joints_of(cell, arm):
    part = next(p for p in cell.parts if p.config.mechanism.name == arm)
    return [f"{arm}.{joint.name}" for joint in part.robot.joints]


def ways_to_fail(cell, joints=None):
    """Yield each arm's brakes, its bus, and each drive that fails, starts anew or is silent."""
    for arm in ("left", "right"):
        all_of_it = joints_of(cell, arm)
        yield f"brakes {arm}", [RigFault(kind="fault", target=j) for j in all_of_it]
        yield f"unplug {arm}", [RigFault(kind="unplug", target=arm)]
        for kind in ("fault", "restart", "silence"):
            for joint in all_of_it:
                if joints is None or joint in joints:
                    yield f"{kind} {joint}", [RigFault(kind=kind, target=joint)]


WORST = ("left.s1", "right.s3", "right.e1")
"""Drives whose faults press most, one way or another; all stand in the README of joint tasks."""


@pytest.mark.parametrize("way", list(WAYS))
def test_no_fault_presses_harder_than_the_cell_allows_however_fast_is_asked(pair, way):
    bound = pair.joint_tasks[0].most_internal_at_fault
    simulation = moving(pair, [SPEED * x for x in WAYS[way]] + [0.0] * 3)
    try:
        before = [np.array(t.beam.pose[:3]) for t in simulation.truths[-11:]]
        assert (before[-1] - before[0]) @ WAYS[way] > 0.1 * 0.05, "it moves along its way"
        for name, faults in ways_to_fail(pair, WORST):
            # What a power stage does is told at once; what is not answered is told by a SYNC.
            for step in (1, 9) if name.startswith(("brakes", "fault")) else (5,):
                found = failed(simulation, faults, step)
                assert found.force < bound, f"{name} at step {step}"
                assert found.mode == "fault", name
    finally:
        simulation.close()


def test_a_faster_motion_is_slowed_along_its_way_and_telemetry_says_by_what(pair):
    simulation = moving(pair, [0.0, SPEED, 0.0, 0.0, 0.0, 0.0])
    simulation.close()
    beam = simulation.states[-1].tasks["beam"]
    assert beam.limits == ("internal_at_fault:left.s1",)
    before = [np.array(t.beam.pose[:3]) for t in simulation.truths[-11:]]
    speed = (before[-1] - before[0]) / 0.1
    assert 0.07 < speed[1] < 0.14
    assert np.abs(speed[[0, 2]]).max() < 0.02 * speed[1]
    assert beam.scale == pytest.approx(speed[1] / SPEED, rel=0.05)
