"""Arms on one payload in the rig's physics: a tick and its drives' loops, without a bus.

Drives interpolate to the setpoint of the tick before, as they do after a SYNC; sensors are read
without noise. What is judged is the truth of the physics.
"""

import dataclasses

import numpy as np
from telerobot.config.load import HERE, load_cell
from telerobot.drivers.rig.nodes.drive_loops import DriveLoops
from telerobot.drivers.rig.physics.world import World
from telerobot.server.commands.commands import Commands
from telerobot.server.control.inputs import Inputs, Intent, StickCommand
from telerobot.server.control.spatial import Pose
from telerobot.server.control.tick import Control

T = 0.01


def pair(folder, *changes, nodes=False):
    """Load the pair with lines of its file changed: (before, after); without nodes and pegs."""
    text = (HERE / "cells/pa10_pair.toml").read_text()
    if not nodes:
        text = text[: text.index("# Mouths")]
        text = "\n".join(line for line in text.splitlines() if not line.startswith("pegs"))
    for before, after in changes:
        assert before in text, f"the cell has no {before!r}"
        text = text.replace(before, after)
    path = folder / "pair.toml"
    path.write_text(text)
    return load_cell(path)


def settings_of(cell):
    """Return each arm's settings, with the gains of the cell's first joint task."""
    task = cell.joint_tasks[0]
    gains = {name: np.array(section.gain) for name, section in task.sources.each.items()}
    gains["following"] = np.zeros(6)
    found = [Commands.from_cell(part).settings.for_control() for part in cell.parts]
    found = [dataclasses.replace(s, gains=gains, wrench_bias=np.zeros(6)) for s in found]
    mrf = task.T_wrist_mrf[0]
    found[0] = dataclasses.replace(found[0], T_wrist_mrf=Pose.from_xyz_rpy(mrf.xyz, mrf.rpy))
    return found


class Carrying:
    """A cell whose arms hold the payload of its joint task, seen by the physics."""

    def __init__(self, cell, misplaced=None, held=True):
        """Close the grasps at the start posture; `misplaced` changes the world before."""
        self.cell, self.world = cell, World(cell)
        if misplaced is not None:
            misplaced(self.world)
            self.world.beam.grasp()
        self.control = Control.of(cell)
        self.settings = settings_of(cell)
        drives = [(p.config.mechanism.drives, p.config.rig.drive) for p in cell.parts]
        self.loops = DriveLoops(drives, self.world.dt)
        for j in range(self.world.n):
            self.loops.engage(j, float(self.world.q[j]))
            self.world.set_brake(j, closed=False)
        self.memory = self.control.seed(self.world.q.copy())
        if not held:
            arms = tuple(dataclasses.replace(m, held=None) for m in self.memory.arms)
            self.memory = self.memory._replace(arms=arms)
        self.time_s, self.command = 0.0, self.world.q.copy()
        self.outputs, self.truth, self.stopped = (), [], set()
        self.wrench_desired = np.zeros(6)
        self.settled()

    def force_gain(self, translation, rotation):
        """Set K_F [m/s/N], [rad/s/(N·m)]."""
        gain = np.array([translation] * 3 + [rotation] * 3)
        self.settings = [
            dataclasses.replace(s, gains={**s.gains, "force": gain}) for s in self.settings
        ]

    def settled(self, seconds=0.5):
        """Let the drives take the weight before control looks."""
        for _ in range(round(seconds / self.world.dt)):
            self.world.step(self.loops.step(self.world.q, self.world.dq))

    def inputs_of_now(self, stick=None, intent=Intent.MOVE, goal=None, blind=()):
        """Return what the arms' sensors and the operator say now."""
        q, inputs = self.world.q.copy(), []
        for i, part in enumerate(self.control.parts):
            wrench = None if i in blind else -self.world.sensor_wrench(i)
            inputs.append(
                Inputs(
                    self.time_s,
                    intent,
                    q[part],
                    self.settings[i],
                    wrench_sensor=wrench,
                    stick=None if stick is None else StickCommand(np.array(stick), np.eye(3)),
                    goal=goal,
                    wrench_desired=self.wrench_desired,
                )
            )
        return inputs

    def tick(self, stick=None, intent=Intent.MOVE, goal=None, blind=()):
        """One period of control and physics; `stick` is the twist (6,) of the MRF in World axes."""
        inputs = self.inputs_of_now(stick, intent, goal, blind)
        before = self.command
        self.memory, self.outputs = self.control.tick(self.memory, inputs)
        assert [o.refusal for o in self.outputs] == [None] * len(self.outputs)
        self.command = np.concatenate([o.command for o in self.outputs])
        for j in range(self.world.n):
            if j not in self.stopped:
                self.loops.aim(j, float(before[j]), T)
        for _ in range(round(T / self.world.dt)):
            self.world.step(self.loops.step(self.world.q, self.world.dq))
        self.time_s += T
        beam = self.world.beam
        self.truth.append((beam.internal_force(), beam.stretch(), beam.pose()[0]))
        return self.outputs

    def outputs_of_rest(self):
        """Return what the first arm tells after a tick without a wish."""
        return self.tick()[0]

    def move_mrf(self, xyz):
        """Move the shared MRF to a place (3,) on the payload, seen from where it was."""
        first = self.settings[0]
        there = first.T_wrist_mrf @ Pose(np.eye(3), np.array(xyz))
        self.settings[0] = dataclasses.replace(
            first, T_wrist_mrf=there, redefined=first.redefined + 1
        )

    def run(self, seconds, stick=None, **more):
        """Go on for a while; return the truth of it: internal force [N], stretch [m], place."""
        first = len(self.truth)
        for _ in range(round(seconds / T)):
            self.tick(stick, **more)
        force, stretch, place = zip(*self.truth[first:], strict=True)
        return np.array(force), np.array(stretch), np.array(place)
