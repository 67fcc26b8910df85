import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.protocols.messages.messages import ClutchRequest, MasterPose
from telerobot.server.commands.commands import Commands
from telerobot.server.commands.haptics import Master
from telerobot.server.control.spatial import Pose, rotation_rpy
from telerobot.server.reflection import Reflector, pose_stiffness
from telerobot.server.refusals import Refused

ENVELOPE = {"seen_tick": 1}
PUSH = np.array([0.0, 0.0, 10.0, 0.0, 0.0, 0.0])
"""10 N on the environment along the tool's axis."""
R_TOOL = rotation_rpy(0.0, np.pi / 2, 0.0)
"""The tool's axis along World's x."""


@pytest.fixture(scope="module")
def cell():
    return load_cell("pa10_reflect")


@pytest.fixture
def reflector(cell):
    contact = cell.config.mechanism.force_torque.stiffest_environment
    return Reflector(cell.config.reflection, contact, cell.config.timing.period_s)


def gains(cell, **of):
    sources = cell.config.sources
    found = {n: np.array(getattr(sources, n).gain) for n in ("joystick", "position", "force")}
    return {**found, **of}


def feel(reflector, cell, wrench=PUSH, seconds=2.0, scale=1.0, leading=False, **of):
    for _ in range(round(seconds / 0.01)):
        reflector.reflect(wrench, gains(cell, **of), R_TOOL, scale, leading)
    return reflector.wrench


def told(reflector):
    return np.array(reflector.message(1).wrench)


def test_the_handle_pushes_back_against_what_the_arm_pushes(reflector, cell):
    feel(reflector, cell)
    np.testing.assert_allclose(told(reflector), [-1.5, 0, 0, 0, 0, 0], atol=1e-4)


def test_the_force_is_told_in_the_axes_of_the_handle(reflector, cell):
    feel(reflector, cell)
    reflector.hear(None, 0.0, rotation_rpy(0.0, 0.0, np.pi / 2))
    np.testing.assert_allclose(told(reflector), [0, 1.5, 0, 0, 0, 0], atol=1e-4)


def test_the_slope_is_the_force_for_each_rate_of_the_stick(reflector, cell):
    feel(reflector, cell)
    rate = 10.0 * cell.config.sources.force.gain[2]  # F = K_HC u / K_F
    assert reflector.slope * rate == pytest.approx(1.5, rel=1e-3)


@pytest.mark.parametrize("wrench", [None, PUSH])
def test_without_a_wrench_or_force_control_the_force_fades_and_does_not_jump(
    reflector, cell, wrench
):
    before = feel(reflector, cell)[0]
    off = {"force": np.zeros(6)} if wrench is not None else {}
    steps = [feel(reflector, cell, wrench, 0.01, **off)[0] for _ in range(200)]
    assert abs(np.diff([before, *steps])).max() < 0.1 * before
    assert steps[-1] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("scale", [0.05, 0.25, 2.0])
def test_a_master_never_feels_more_than_the_cells_stiffness(reflector, cell, scale):
    """The arm against a wall, from its two laws alone: K_P (target - x) = K_F F, F = k_e x."""
    wall, reached = 20_000.0, 0.01
    k_p, k_f = cell.config.sources.position.gain[0], cell.config.sources.force.gain[0]
    x = k_p * scale * reached / (k_p + k_f * wall)
    push = np.array([0.0, 0.0, wall * x, 0.0, 0.0, 0.0])
    felt = feel(reflector, cell, push, 3.0, scale, leading=True)[0] / reached
    full = pose_stiffness(np.array(cell.config.reflection.gain), scale, *gains_of(cell), wall)
    assert felt == pytest.approx(min(full, cell.config.reflection.stiffness), rel=1e-3)


def gains_of(cell):
    g = gains(cell)
    return g["force"], g["position"]


# --- the net ------------------------------------------------------------


GIVEN = 0.02
"""What the hand is given each time [J]."""


def bounce(reflector, times, period_s=0.5):
    """Give the hand energy again and again; return how often the net tripped."""
    trips = 0
    for i in range(times):
        reflector.hear((0.0, (i + 1) * GIVEN, 0.0), i * period_s, np.eye(3))
        trips += reflector.take_trip()
    return trips


def test_a_handle_that_goes_on_giving_energy_trips_the_net_and_is_held_back(reflector, cell):
    feel(reflector, cell)
    assert bounce(reflector, 8) == 1
    assert reflector.tripped
    assert feel(reflector, cell)[0] == pytest.approx(0.0, abs=1e-4)


def test_what_one_contact_gives_does_not_trip_it(reflector):
    assert bounce(reflector, 4, period_s=5.0) == 0


def test_the_force_comes_back_once_half_of_it_is_made_up(reflector, cell):
    bounce(reflector, 8)
    feel(reflector, cell)
    reflector.hear((0.0, 8 * GIVEN, 0.0), 20.0, np.eye(3))
    assert not reflector.tripped
    assert feel(reflector, cell)[0] == pytest.approx(1.5, rel=1e-3)


def test_unprotected_the_net_only_tells(reflector, cell):
    reflector.protected = False
    assert bounce(reflector, 8) == 1
    assert feel(reflector, cell)[0] == pytest.approx(1.5, rel=1e-3)


# --- the arm's port ------------------------------------------------------------


def lead(reflector, cell, entered, metres=0.02):
    """Push a master into a wall that is felt already; return how far the target went."""
    feel(reflector, cell, scale=0.1, leading=True)
    master, T = Master(), Pose.identity()
    master.set(ClutchRequest(**ENVELOPE, engaged=True))
    for i in range(101):
        x = metres * i / 100
        handle = (entered * i / 100, 0.0, 0.0)
        pose = MasterPose(**ENVELOPE, xyz=(x, 0.0, 0.0), rpy=(0.0, 0.0, 0.0), handle=handle)
        master.take(pose, 0.01 * i, np.eye(3), T, reflector)
    return master.target.p[0]


def test_a_master_leads_as_far_as_energy_has_come_with_it(reflector, cell):
    full = cell.config.reflection.energy_bound
    assert lead(reflector, cell, entered=full) == pytest.approx(0.02)


def test_without_energy_from_the_hand_the_target_goes_no_further_than_the_reserve(reflector, cell):
    gone = lead(reflector, cell, entered=0.0, metres=0.04)
    assert 0.0 < gone < 0.04
    assert reflector.port.left == pytest.approx(0.5 * cell.config.reflection.energy_bound)


def test_unprotected_a_master_leads_all_the_way(reflector, cell):
    reflector.protected = False
    assert lead(reflector, cell, entered=0.0, metres=0.04) == pytest.approx(0.04)


# --- the switch ------------------------------------------------------------


def test_enabling_anew_protects_again(cell):
    commands = Commands.from_cell(cell)
    commands.protect_handle(False)
    assert not commands.reflector.protected
    commands.clear()
    assert commands.reflector.protected


def test_a_cell_without_reflection_refuses_the_switch_and_tells_nothing(cell):
    commands = Commands.from_cell(altered(cell, {"reflection": None}))
    with pytest.raises(Refused, match="reflects no forces"):
        commands.protect_handle(False)
    assert commands.reflector is None
