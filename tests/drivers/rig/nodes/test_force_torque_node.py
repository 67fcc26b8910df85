"""The simulated force/torque sensor through its frames."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from telerobot.config.load import altered, load_cell
from telerobot.protocols.canopen import robotous
from telerobot.protocols.messages.rig import RigFault

from ..conftest import Master

COMMAND, FIRST, SECOND = 0x64, 0x01, 0x02


def samples(master: Master, seconds: float) -> NDArray[np.float64]:
    """Return what comes in within `seconds`, (k, 6) [N, N·m]."""
    found = heard(master, seconds)
    return np.array([(*s.force, *s.torque) for s in found]).reshape(-1, 6)


def overloads(master: Master, seconds: float) -> NDArray[np.int_]:
    """Return the overload statuses that come in within `seconds` (k,)."""
    return np.array([s.overload for s in heard(master, seconds)])


def heard(master: Master, seconds: float) -> list[robotous.Sample]:
    before = len(master.frames)
    master.rig.advance(seconds)
    master.listen()
    halves: dict[int, list[bytes]] = {FIRST: [], SECOND: []}
    for _, can_id, data in master.frames[before:]:
        if can_id in halves:
            halves[can_id].append(data)
    return [robotous.join_sample(a, b) for a, b in zip(*halves.values(), strict=True)]


@pytest.fixture
def pa10_with() -> Iterator[Callable[..., Master]]:
    """Make a master of a PA-10 whose sensor has some imperfections of its own."""
    made: list[Master] = []

    def make(**truth: object) -> Master:
        cell = load_cell("pa10")
        rig = cell.config.rig
        assert rig is not None
        sensor = rig.force_torque.model_copy(update=truth)
        made.append(Master(altered(cell, {"rig.force_torque": sensor})))
        return made[-1]

    yield make
    for master in made:
        master.close()


@pytest.fixture
def running(master: Master) -> Master:
    master.rig.advance(0.05)
    master.send(COMMAND, robotous.start())
    return master


def test_it_is_silent_until_started_and_again_when_stopped(master: Master) -> None:
    assert len(samples(master, 0.1)) == 0
    master.send(COMMAND, robotous.start())
    assert len(samples(master, 0.1)) == 20
    master.send(COMMAND, robotous.stop())
    assert len(samples(master, 0.1)) == 0


@pytest.mark.parametrize(("rate", "count"), [(100, 100), (333, 333), (1000, 1000)])
def test_it_runs_freely_at_the_rate_set_while_stopped(
    master: Master, rate: int, count: int
) -> None:
    master.send(COMMAND, robotous.set_rate(rate))
    master.send(COMMAND, robotous.start())
    assert len(samples(master, 1.0)) == pytest.approx(count, abs=1)
    master.send(COMMAND, robotous.set_rate(200))
    assert len(samples(master, 1.0)) == pytest.approx(count, abs=1)


def test_it_reads_payload_and_bias_with_the_noise_of_the_cell(running: Master) -> None:
    rig = running.cell.config.rig
    assert rig is not None
    read = samples(running, 2.0)
    # the hand, held horizontally: its weight is the sensor's +x, its moment +y
    expected = np.array([0.98 * 9.81, 0, 0, 0, 0.98 * 9.81 * 0.051, 0]) + rig.force_torque.bias
    np.testing.assert_allclose(read.mean(axis=0), expected, atol=0.02)
    assert read[:, 1].std() == pytest.approx(rig.force_torque.noise[1], rel=0.3)


def test_one_that_sits_askew_reads_in_its_own_axes(pa10_with) -> None:
    turned = pa10_with(mounting_rpy=(0.0, 0.0, np.pi / 2), bias=(0.0,) * 6)
    turned.rig.advance(0.05)
    turned.send(COMMAND, robotous.start())
    read = samples(turned, 1.0).mean(axis=0)
    expected = [0, -0.98 * 9.81, 0, 0.98 * 9.81 * 0.051, 0, 0]
    np.testing.assert_allclose(read, expected, atol=0.02)


def test_cross_talk_shows_each_force_in_the_others(pa10_with) -> None:
    mixed = pa10_with(cross_talk=0.02, bias=(0.0,) * 6)
    mixed.rig.advance(0.05)
    mixed.send(COMMAND, robotous.start())
    read = samples(mixed, 4.0).mean(axis=0)
    weight = 0.98 * 9.81
    np.testing.assert_allclose(np.abs(read[:3]), [weight, 0.02 * weight, 0.02 * weight], atol=0.01)
    small = 0.02 * weight * (0.051 + 0.025)
    assert read[4] == pytest.approx(weight * 0.051, abs=0.02 * weight * 0.025 + 1e-3)
    assert 0 < np.abs(read[[3, 5]]).max() < small + 1e-3


def test_readings_are_whole_steps(running: Master) -> None:
    read = samples(running, 0.5) * ([50] * 3 + [2000] * 3)
    np.testing.assert_allclose(read, np.round(read), atol=1e-9)


def test_beyond_its_range_it_reads_the_end_and_reports_an_overload(running: Master) -> None:
    assert not overloads(running, 0.1).any()
    running.rig.inject(RigFault(kind="push", target="force_torque", vector=(-500.0, 0.0, 700.0)))
    samples(running, 0.1)
    read = samples(running, 0.1)
    assert overloads(running, 0.1).all()
    at_its_end = np.isclose(np.abs(read), robotous.RAILS).all(axis=0)
    assert at_its_end.any()
    assert (np.abs(read) <= robotous.RAILS).all()
    running.rig.inject(RigFault(kind="push", target="force_torque", on=False))
    samples(running, 0.1)
    assert not overloads(running, 0.1).any()


def test_the_bias_command_takes_the_present_load_as_zero(running: Master) -> None:
    running.send(COMMAND, robotous.bias())
    assert np.abs(samples(running, 1.0).mean(axis=0)).max() < 0.02
    running.send(COMMAND, robotous.clear_bias())
    assert samples(running, 0.5).mean(axis=0)[0] > 9


def test_a_push_shows_as_a_load(running: Master) -> None:
    before = samples(running, 0.5).mean(axis=0)
    running.rig.inject(RigFault(kind="push", target="force_torque", vector=(-20.0, 0.0, 0.0)))
    samples(running, 0.1)
    after = samples(running, 0.5).mean(axis=0)
    np.testing.assert_allclose((after - before)[:3], [0, 0, -20], atol=0.1)
    running.rig.inject(RigFault(kind="push", target="force_torque", on=False))
    samples(running, 0.1)
    np.testing.assert_allclose(samples(running, 0.5).mean(axis=0), before, atol=0.1)


def test_a_zero_goes_off_at_once_or_as_slowly_as_it_is_told(running: Master) -> None:
    before = samples(running, 0.5).mean(axis=0)
    fault = RigFault(kind="bias", target="force_torque", vector=(2.0, 0.0, -4.0))
    running.rig.inject(fault)
    after = samples(running, 0.5).mean(axis=0)
    np.testing.assert_allclose((after - before)[:3], fault.vector, atol=0.1)
    running.rig.inject(fault.model_copy(update={"value": 10.0}))
    after = samples(running, 1.0).mean(axis=0)
    np.testing.assert_allclose((after - before)[:3], (0.1, 0.0, -0.2), atol=0.05)
    running.rig.inject(RigFault(kind="bias", target="force_torque", on=False))
    np.testing.assert_allclose(samples(running, 0.5).mean(axis=0), before, atol=0.1)
    with pytest.raises(ValueError, match="give its vector"):
        running.rig.inject(RigFault(kind="bias", target="force_torque"))


def test_a_frozen_sensor_repeats_itself_or_says_nothing(running: Master) -> None:
    samples(running, 0.1)
    running.rig.inject(RigFault(kind="freeze", target="force_torque"))
    assert np.ptp(samples(running, 0.5), axis=0).max() == 0
    running.rig.inject(RigFault(kind="freeze", target="force_torque", value=1.0))
    assert len(samples(running, 0.5)) == 0
    running.rig.inject(RigFault(kind="freeze", target="force_torque", on=False))
    assert np.ptp(samples(running, 0.5), axis=0).max() > 0
