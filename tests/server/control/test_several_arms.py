"""Several arms in one tick: each works as it would alone, and they never meet."""

import dataclasses

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.drivers.rig.physics.world import World
from telerobot.server.commands.commands import Commands
from telerobot.server.control.inputs import Inputs, Intent, StickCommand
from telerobot.server.control.tick import Control

T = 0.01
NO_BALL = "[rig]\ntool_radius = 0.0\n"
"""The ball at the tool, which is to touch things, would be no part of the promise."""


@pytest.fixture
def pair(two_arms):
    """Return a function that loads two PA-10s whose bases are so far from the middle [m]."""

    def load(left, right):
        turned = f"xyz = [0.1, {right}, 0.0], rpy = [0.0, 0.0, 0.5]"
        path = two_arms(like=("pa10", "pa10"), bases=(left, turned), more=NO_BALL)
        return load_cell(path)

    return load


class Run:
    """Ticks of a cell whose joints are where they were told to be."""

    def __init__(self, cell):
        self.cell, self.control = cell, Control.of(cell)
        self.settings = [Commands.from_cell(part).settings.for_control() for part in cell.parts]
        ready = [part.config.mechanism.postures["ready"] for part in cell.parts]
        self.memory = self.control.seed(np.concatenate(ready))
        self.sent = [np.concatenate(ready)] * 3

    def tick(self, *sticks, intent=Intent.MOVE):
        """One period; `sticks` are twists (6,) in World axes."""
        inputs = [
            Inputs(
                T * len(self.sent),
                intent,
                self.memory.commanded.sent[1][part],
                dataclasses.replace(settings),
                stick=StickCommand(np.array(stick), np.eye(3)),
            )
            for part, settings, stick in zip(self.control.parts, self.settings, sticks, strict=True)
        ]
        self.memory, outputs = self.control.tick(self.memory, inputs)
        assert [o.refusal for o in outputs] == [None] * len(outputs)
        self.sent.append(np.concatenate([o.q for o in outputs]))
        return outputs

    def observe(self):
        """Judge all that was sent by the bounds of the drives."""
        q = np.array(self.sent)
        drives = [d for part in self.cell.parts for d in part.config.mechanism.drives]
        joints = [j for part in self.cell.parts for j in part.robot.joints]
        assert (q >= [j.lower for j in joints]).all()
        assert (q <= [j.upper for j in joints]).all()
        for order, key in enumerate(("max_velocity", "max_acceleration", "max_jerk"), start=1):
            bound = np.array([getattr(d, key) for d in drives]) * T**order
            assert (np.abs(np.diff(q, order, axis=0)) <= bound * (1 + 1e-5) + 1e-12).all()


def hostile(rng, ticks):
    """Sticks of both operators: towards each other, reversing, anything."""
    sticks = np.zeros((2, 6))
    for i in range(ticks):
        if i % 40 == 0:
            sticks = rng.uniform(-1, 1, (2, 6)) * [0.4, 0.4, 0.4, 1.0, 1.0, 1.0]
            if rng.random() < 0.6:
                sticks[0, 1], sticks[1, 1] = -0.4, 0.4
        yield sticks


@pytest.mark.parametrize("seed", range(4))
def test_two_arms_under_two_sticks_never_meet(pair, seed):
    cell, rng = pair(0.55, -0.6), np.random.default_rng(seed)
    run, world = Run(cell), World(cell)
    promised = cell.config.avoidance.self_clearance
    least, near = np.inf, 0
    for i, sticks in enumerate(hostile(rng, 900)):
        outputs = run.tick(*sticks)
        between = [g for g in outputs[0].gaps if {g.link[:4], g.other[:4]} == {"left", "righ"}]
        near += any(g.active for g in between)
        if i % 5 == 0:
            world.q[:] = run.sent[-1]
            least = min(least, world.distances.between_arms())
    run.observe()
    # The capsules are around the housings, so that these are farther apart than promised.
    assert least >= promised - 1e-3
    assert near > 20, "they never came near each other: the run shows nothing"


def test_arms_far_from_each_other_go_as_each_does_alone(pair):
    cell, rng = pair(10.0, -10.0), np.random.default_rng(1)
    both, alone = Run(cell), [Run(part) for part in cell.parts]
    for sticks in hostile(rng, 300):
        both.tick(*sticks)
        for run, stick in zip(alone, sticks, strict=True):
            run.tick(stick)
    apart = np.concatenate([run.sent for run in alone], axis=1)
    # Where no verified stop took over, which stops both.
    np.testing.assert_allclose(both.sent[:100], apart[:100], atol=1e-9)
    both.observe()


def test_what_stops_one_arm_stops_both_and_holds_them(pair):
    run = Run(pair(0.55, -0.6))
    for _ in range(60):
        run.tick([0.2, 0, 0, 0, 0, 0], [0, 0, 0.2, 0, 0, 0])
    moving = run.sent[-1] - run.sent[-2]
    assert np.abs(moving[:7]).max() > 1e-4
    assert np.abs(moving[7:]).max() > 1e-4
    for _ in range(100):
        outputs = run.tick(np.zeros(6), np.zeros(6), intent=Intent.STOP)
    assert all(o.at_rest for o in outputs)
    run.observe()
