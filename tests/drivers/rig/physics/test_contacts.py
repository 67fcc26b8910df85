"""Contact forces of the physics: nothing cancels, and no spike is missed."""

import mujoco
import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.drivers.rig.physics.contacts import Contacts
from telerobot.drivers.rig.physics.geoms import fixed, of_arm
from telerobot.drivers.rig.physics.world import World

BALL_KG, G = 2.0, 9.81
STEPS = 10


class Squeezed:
    """A ball that slides between two walls, in the place of an arm; `gap` is its room [m]."""

    def __init__(self, gap: float) -> None:
        spec = mujoco.MjSpec()
        spec.option.gravity[:] = 0.0
        body = spec.worldbody.add_body(name="arm")
        body.mass, body.inertia, body.explicitinertial = BALL_KG, [0.01] * 3, True
        body.add_freejoint()
        ball = of_arm(body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(0.1, 0, 0)))
        ball.density = 0
        for side in (-1.0, 1.0):
            at = (side * (0.5 * gap + 0.05), 0.0, 0.0)
            kind = mujoco.mjtGeom.mjGEOM_BOX
            fixed(spec.worldbody.add_geom(type=kind, size=(0.05, 1, 1), pos=at))
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        walls = np.flatnonzero(self.model.geom_bodyid == 0).tolist()
        self.contacts = Contacts(self.model, self.data, walls, [1], STEPS)
        mujoco.mj_forward(self.model, self.data)

    def step(self) -> None:
        mujoco.mj_step(self.model, self.data)
        self.contacts.note()


def test_walls_that_press_from_both_sides_do_not_cancel():
    squeezed = Squeezed(gap=0.199)
    assert np.linalg.norm(squeezed.contacts.force(0)) < 1e-6
    sides = [np.zeros(6), np.zeros(6)]
    for i, wrench in enumerate(sides):
        mujoco.mj_contactForce(squeezed.model, squeezed.data, i, wrench)
    pressed = sum(wrench[0] for wrench in sides)
    assert pressed > 1.0
    assert squeezed.contacts.total(0) == pytest.approx(pressed, rel=1e-6)


def test_a_blow_between_two_looks_stays_in_the_period_that_it_fell_in():
    thrown = Squeezed(gap=0.3)
    thrown.data.qvel[0] = 5.0
    greatest = 0.0
    while not thrown.contacts.total(0):
        thrown.step()
    while thrown.contacts.total(0):
        greatest = max(greatest, thrown.contacts.total(0))
        thrown.step()
    assert greatest > 100.0
    assert thrown.contacts.total(0) == 0.0
    assert thrown.contacts.peak(0) == greatest
    for _ in range(STEPS):
        thrown.step()
    assert thrown.contacts.peak(0) == 0.0


def test_an_arm_that_lies_on_the_floor_presses_on_it_and_its_wheels_do_not():
    world = World(load_cell("rover"))
    for _ in range(300):
        world.step(np.zeros(world.n))
    assert world.data.ncon >= 3
    assert world.contacts.total(0) == world.contacts.own() == 0.0
    for joint in range(world.n):
        world.set_brake(joint, closed=False)
    for _ in range(3000):
        world.step(np.zeros(world.n))
    assert world.contacts.total(0) + world.contacts.own() > 0.0


@pytest.mark.parametrize("depth", [1e-6, 1e-5, 1e-4])
def test_what_is_moved_into_a_link_that_cannot_give_way_presses_as_stiffly_as_steel(depth):
    """The first link of a PA-10 turns about its own axis, and a ball that is told where to be."""
    world, radius, link = World(load_cell("pa10_scene")), 0.12, 0.09
    world.place("visitor", np.array([depth - radius - link, 0.0, 0.24]))
    mujoco.mj_forward(world.model, world.data)
    assert 1e7 * depth < world.contacts.total(0) < 1e9 * depth
