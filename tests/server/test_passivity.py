"""The ports give out no more than their reserves, whatever hand, arm and network do."""

from collections import deque

import numpy as np
import pytest
from telerobot.server.reflection import Port, admit, damping

RESERVE = 0.01
STEP_S = 0.001


class Net:
    """Motions one way and forces the other, each late by its own number of steps, energies along.

    `loss` is the part of the news that never arrives: the older one stays in force.
    """

    def __init__(self, out, back, loss=0.0, seed=0):
        self.out, self.back = deque([(np.zeros(6), 0.0)] * (out + 1)), deque()
        self.back.extend([(np.zeros(6), 0.0)] * (back + 1))
        self.arm, self.handle = Port(), Port()
        self.loss, self.draw = loss, np.random.default_rng(seed)
        self.arm_true = self.handle_true = 0.0
        self.at_arm, self.at_handle = self.out[0], self.back[0]
        self.place = self.led = np.zeros(6)

    def step(self, velocity, force_of):
        """One step: `velocity` (6,) of the handle, `force_of` a place (6,) the arm's force (6,)."""
        felt, far = self.at_handle
        speed2 = float(velocity @ velocity)
        b = damping(self.handle, far, RESERVE, speed2, STEP_S)
        moved = STEP_S * velocity
        kept = b * float(velocity @ moved)
        self.handle = self.handle.passed(float(felt @ moved))
        self.handle = self.handle._replace(damped=self.handle.damped + kept)
        self.handle_true += float((felt + b * velocity) @ moved)
        self.place = self.place + moved
        self.out.append((self.place, self.handle.entered))
        arrived = self.out.popleft()
        force = force_of(self.led)
        if self.draw.random() >= self.loss:
            asked = arrived[0] - self.at_arm[0]
            self.arm, let = admit(self.arm, arrived[1], RESERVE, force, asked)
            self.arm_true -= float(force @ let)
            self.led = self.led + let
            self.at_arm = arrived
        self.back.append((force, self.arm.entered))
        news = self.back.popleft()
        if self.draw.random() >= self.loss:
            self.at_handle = news

    @property
    def stored(self):
        """Energy that the network has got and not given back, by the works at its ports alone."""
        return self.arm_true + self.handle_true


def spring(stiffness):
    return lambda place: stiffness * np.maximum(place, 0.0)


@pytest.mark.parametrize(("out", "back"), [(0, 0), (10, 10), (250, 250), (30, 400)])
@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_the_ports_give_out_no_more_than_their_reserves(out, back, loss):
    net, draw = Net(out, back, loss), np.random.default_rng(out + back)
    velocity, worst = np.zeros(6), 0.0
    for _ in range(3000):
        velocity = 0.99 * velocity + draw.normal(0.0, 0.02, 6)
        net.step(velocity, spring(300.0))
        worst = min(worst, net.stored)
    # The handle pays within the step after the one in which too much has left.
    slack = 2.0 * STEP_S * 300.0 * float(np.abs(net.place).max())
    assert worst > -2.0 * RESERVE - slack


def test_without_them_the_same_network_gives_out_much_more():
    draw, energy = np.random.default_rng(500), 0.0
    place, velocity, history = np.zeros(6), np.zeros(6), deque([np.zeros(6)] * 501)
    worst = 0.0
    for _ in range(3000):
        velocity = 0.99 * velocity + draw.normal(0.0, 0.02, 6)
        before = history[250]
        place = place + STEP_S * velocity
        history.append(place)
        felt = spring(300.0)(history.popleft())
        arm = history[250] - before
        energy += float(felt @ velocity) * STEP_S - float(spring(300.0)(before) @ arm)
        worst = min(worst, energy)
    assert worst < -20.0 * RESERVE


def test_what_may_leave_is_let_through_unchanged():
    moved = np.array([0.001, -0.002, 0.0, 0.01, 0.0, 0.0])
    force = np.array([2.0, 1.0, 0.0, 0.1, 0.0, 0.0])
    port, let = admit(Port(), 1.0, 0.0, force, moved)
    np.testing.assert_array_equal(let, moved)
    assert port.left == pytest.approx(float(force @ moved))


def test_what_may_not_leave_is_taken_along_the_force_alone_and_never_turned_back():
    moved = np.array([0.001, 0.002, 0.0, 0.0, 0.0, 0.0])
    force = np.array([10.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    port, let = admit(Port(), 0.004, 0.0, force, moved)
    np.testing.assert_allclose(let, [0.0004, 0.002, 0.0, 0.0, 0.0, 0.0], atol=1e-15)
    assert port.left == pytest.approx(0.004)
    _, none = admit(port, 0.004, 0.0, force, moved)
    np.testing.assert_allclose(none, [0.0, 0.002, 0.0, 0.0, 0.0, 0.0], atol=1e-15)


def test_moving_back_puts_energy_into_the_network_and_is_never_held():
    moved, force = np.array([-0.001, 0, 0, 0, 0, 0]), np.array([10.0, 0, 0, 0, 0, 0])
    port, let = admit(Port(left=5.0), 0.0, 0.0, force, moved)
    np.testing.assert_array_equal(let, moved)
    assert port.entered == pytest.approx(0.01)


def test_the_damping_pays_exactly_what_is_owed_in_one_step():
    port = Port(entered=1.0, left=0.5, damped=0.1)
    b = damping(port, 0.2, 0.05, 0.3**2, STEP_S)
    assert b * 0.3**2 * STEP_S == pytest.approx(0.5 - 0.1 - 0.2 - 0.05)
    assert damping(port, 0.4, 0.05, 0.3**2, STEP_S) == 0.0


def test_what_the_hand_never_put_in_does_not_leave_whatever_the_arm_says():
    assert damping(Port(entered=0.0, left=0.1), 100.0, 0.0, 1.0, STEP_S) > 0.0
