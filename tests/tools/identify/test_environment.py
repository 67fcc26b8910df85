import numpy as np
import pytest
from telerobot.config.errors import ConfigError
from telerobot.config.load import altered, load_cell
from telerobot.protocols import topics as t
from telerobot.protocols.codec import decode_as, encode
from telerobot.protocols.messages import requests
from telerobot.protocols.messages.telemetry import State
from telerobot.server.identification.environment import Along, Environment, environment, propose
from telerobot.server.identification.payload import NotIdentified
from telerobot.server.stability.judgement import LoopBounds
from telerobot.tools.cli import main
from telerobot.tools.client.protocol_client import ProtocolClient
from telerobot.tools.identify.environment import Press, PressGuide, allowed, report

PERIOD_S = 0.01
NOISE_N = 0.05
AT = 0.004
"""Where the wall is: from where the tool sets out [m]."""


def found_by(cell, guide):
    """Return what the presses of a guide that is through tell."""
    guide.checked()
    return environment(cell, guide.press.along, guide.steady, guide.way, guide.samples)


class Arm:
    """A tool in one dimension, led by force control as the daemon has it, before a spring.

    Joints follow a command `joints_late` periods later, the sensor them by `force_late`.
    """

    def __init__(self, stiffness=20e3, press=None, joints_late=1, force_late=1, damping=0.0):
        self.stiffness, self.damping = stiffness, damping
        self.joints_late, self.force_late = joints_late, force_late
        self.offset, self.sensor_sign, self.joint_sign = 0.3, 1.0, 1.0
        self.noise_n = NOISE_N
        self.state = {"mode": "enabled", "at_goal": True}
        self.sources = {"force": (0.0,) * 6}
        self.reply = requests.Reply(ok=True)
        self.gain, self.desired, self.x = 0.0, 0.0, 0.0
        self.xs = [0.0] * 20
        self.noise = np.random.default_rng(1)
        self.time_s, self.said, self.gains = 0.0, [], []
        self.client = ProtocolClient("ann", "cell", self.put, self.ask, secret=bytes(32), epoch=1)
        self.press = press or Press(Along.of("z"), 0.02, 15.0)
        self.guide = PressGuide(self.client, self.press, say=self.said.append)

    def put(self, topic, payload, _proof):
        message = decode_as(topic.message, payload)
        if topic is t.FORCE:
            self.desired = self.press.along.sign * message.wrench[2]
        elif topic is t.POSITION:
            self.x, self.gain = 0.0, 0.0

    def ask(self, topic, payload, answer, _proof):
        if topic is t.GAIN:
            self.gain = decode_as(topic.message, payload).gain[2]
            self.gains.append(self.gain)
        answer(encode(self.reply))

    def go(self, seconds, until=lambda: False):
        for _ in range(round(seconds / PERIOD_S)):
            if self.guide.over or until():
                return
            self.step()

    def step(self):
        self.time_s += PERIOD_S
        measured = self.joint_sign * self.xs[-1 - self.joints_late]
        after, deep, before = (self.xs[i - self.joints_late - self.force_late] for i in (0, -1, -2))
        force = self.stiffness * (deep - AT) + self.damping * (after - before) / (2.0 * PERIOD_S)
        force = max(0.0, force) if deep > AT else 0.0
        read = force + self.offset + self.noise_n * self.noise.normal()
        wrench = [0.0, 0.0, self.press.along.sign * self.sensor_sign * read, 0.0, 0.0, 0.0]
        pose = lambda x: (0.0, 0.0, self.press.along.sign * x, 0.0, 0.0, 0.0)  # noqa: E731
        state = {
            "tick": round(self.time_s / PERIOD_S),
            "time_s": self.time_s,
            "pose_mrf": pose(self.xs[-1]),
            "pose_mrf_measured": pose(measured),
            "wrench_mrf": tuple(wrench),
            "sources": self.sources,
            "gains": {"force": (7.5e-4,) * 3 + (0.03,) * 3},
            "on": {"force": True},
            "last_seq": {x.key: self.client.seq for x in (t.POSTURE, t.POSITION)},
            **self.state,
        }
        self.guide.run(State.model_construct(**state))
        self.x += PERIOD_S * self.gain * (self.desired - self.sensor_sign * read)
        self.xs.append(self.x)


@pytest.fixture(scope="module")
def pa10():
    return load_cell("pa10")


@pytest.mark.parametrize("along", ["z", "-z"])
@pytest.mark.parametrize("stiffness", [2e3, 20e3, 200e3])
def test_a_spring_is_told_with_its_damping_and_the_delay_of_both_parts(pa10, stiffness, along):
    press = Press(Along.of(along), 0.02, 15.0)
    arm = Arm(stiffness, press, joints_late=2, force_late=1, damping=300.0)
    arm.go(120.0)
    found = found_by(pa10, arm.guide)
    assert found.stiffness == pytest.approx(stiffness, rel=0.01)
    assert found.repeatability < 0.01 * stiffness
    assert found.with_drives == pytest.approx(stiffness, rel=0.01)
    assert found.delay_periods == pytest.approx(3.0, abs=0.3)
    assert found.damping == pytest.approx(300.0, abs=60.0)
    assert found.forces[0] < 0.5 * found.forces[1] < 8.0


@pytest.mark.parametrize(("stiffness", "late"), [(2e3, 1), (2e3, 4), (20e3, 4), (100e3, 1)])
def test_a_sensor_with_ten_times_the_noise_tells_no_worse_than_five_hundredths(
    pa10, stiffness, late
):
    arm = Arm(stiffness, joints_late=late, force_late=late)
    arm.noise_n = 10.0 * NOISE_N
    arm.go(240.0)
    assert found_by(pa10, arm.guide).stiffness == pytest.approx(stiffness, rel=0.05)


def test_the_tool_goes_back_and_has_its_own_gains_again():
    arm = Arm()
    arm.go(60.0)
    assert arm.guide.failure == ""
    assert arm.x == pytest.approx(0.0, abs=1e-3)
    assert arm.gains[-1] == 7.5e-4
    assert max(arm.gains[:-1]) < 7.5e-4


def noisy(arm):
    arm.offset = 5.0


def pulling(arm):
    arm.sensor_sign, arm.offset = -1.0, 0.0


def backwards(arm):
    arm.joint_sign = -1.0


def stuck(arm):
    arm.state["at_goal"] = False


def blind(arm):
    arm.state["wrench_mrf"] = None


def held(arm):
    arm.state["mode"] = "hold"


def steered(arm):
    arm.sources = {"force": (0.0,) * 6, "spring": (0.01,) + (0.0,) * 5}


def barred(arm):
    arm.reply = requests.Reply(ok=False, reason="no_lease", detail="of another")


def soft(arm):
    arm.stiffness = 0.0


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (soft, "nothing touched within 20 mm"),
        (held, "mode became hold"),
        (backwards, "joints in the wrong direction, or held"),
        (pulling, "the sign of its axis"),
        (noisy, "before anything is touched"),
        (blind, "stale or missing"),
        (steered, "source spring moves the tool"),
        (barred, "no_lease"),
    ],
    ids=lambda x: getattr(x, "__name__", ""),
)
def test_what_is_wrong_is_named_in_one_line(pa10, spoil, words):
    arm = Arm()
    spoil(arm)
    arm.go(90.0)
    assert arm.guide.over
    with pytest.raises(NotIdentified, match=words) as told:
        found_by(pa10, arm.guide)
    assert "\n" not in str(told.value)


def test_gains_are_as_before_where_a_stop_ends_it_in_the_middle():
    arm = Arm()
    arm.go(60.0, until=lambda: len(arm.guide.steady) == 2)
    before = arm.guide._before.gains["force"][2]
    assert arm.gains[-1] != before
    arm.state["mode"] = "hold"
    arm.go(1.0)
    assert arm.guide.over
    assert arm.guide.failure == "mode became hold"
    assert arm.gains[-1] == before


def test_contact_that_is_lost_while_pressing_is_named():
    arm = Arm()
    arm.go(60.0, until=lambda: len(arm.guide.steady) == 2)
    arm.stiffness = 0.0
    arm.go(60.0)
    assert arm.guide.failure == "contact lost"


def test_a_tool_that_bounces_is_named_and_taken_back():
    arm = Arm(stiffness=1.5e6, joints_late=3, force_late=2)
    arm.press = arm.guide.press = Press(Along.of("z"), 0.02, 20.0)
    arm.go(60.0)
    assert "bounces" in arm.guide.failure or "force bound reached" in arm.guide.failure
    assert arm.x == pytest.approx(0.0, abs=1e-3)


def test_a_force_beyond_its_bound_ends_it_at_once():
    arm = Arm()
    arm.go(60.0, until=lambda: len(arm.guide.steady) == 1)
    arm.offset += 30.0
    arm.step()
    assert arm.guide.failure.startswith("force bound reached")
    arm.go(60.0)
    assert arm.guide.over
    assert arm.x == pytest.approx(0.0, abs=1e-3)


def test_a_wall_right_before_the_tool_tells_nothing_of_the_joints():
    arm = Arm(stiffness=20e3)
    arm.xs = [AT - 1e-4] * 20
    arm.x = AT - 1e-4
    arm.go(60.0)
    assert "set out further away" in arm.guide.failure


def test_a_posture_that_is_not_reached_is_named():
    arm = Arm(press=Press(Along.of("z"), 0.02, 15.0, "ready"))
    stuck(arm)
    arm.go(90.0)
    assert "posture 'ready' not reached" in arm.guide.failure


@pytest.mark.parametrize("stiffness", [2e3, 20e3, 200e3])
def test_what_is_proposed_keeps_its_margins_as_check_judges_them(pa10, stiffness):
    found = Environment(stiffness, 10.0, stiffness, 0.0, 1.5, 3.84, (5.0, 15.0), 1e-3)
    gains = propose(pa10, found, Along.of("z"))
    told = {
        "mechanism.force_torque.stiffest_environment": stiffness,
        "sources.force.gain": gains.gain,
        "sources.following.damping": gains.damping,
        "sources.following.stiffest_hand": stiffness,
    }
    bounds = LoopBounds(altered(pa10, told))
    assert bounds.gain("force", gains.gain).share == pytest.approx(0.5, abs=0.01)
    following = pa10.config.sources.following.gain
    assert bounds.gain("following", following).share == pytest.approx(0.5, abs=0.01)
    assert gains.loop_gain == pytest.approx(gains.gain[2] * stiffness * 0.01, rel=0.01)
    assert gains.loop_gain < 0.5 * gains.bound
    assert gains.gain[5] <= 0.03
    assert max(gains.gain[:2]) <= 7.5e-4
    assert f"{gains.gain[2]:g}, " in report(pa10, found, gains)


def test_a_delay_that_is_seen_beyond_the_models_lowers_the_gains(pa10):
    seen = [
        propose(pa10, Environment(2e4, 1.0, 2e4, 0.0, d, 3.84, (5.0, 15.0), 1e-3), Along.of("z"))
        for d in (1.5, 8.0)
    ]
    assert seen[1].gain[2] < 0.6 * seen[0].gain[2]
    assert seen[1].bound < 0.6 * seen[0].bound


@pytest.mark.parametrize("stiffness", [2e3, 20e3, 100e3])
def test_a_delay_that_is_seen_beyond_the_models_keeps_the_margin_of_every_axis(pa10, stiffness):
    found = Environment(stiffness, 1.0, stiffness, 0.0, 8.0, 3.84, (5.0, 15.0), 1e-3)
    gains = propose(pa10, found, Along.of("z"))
    assert 0.45 < gains.share < 0.51
    # About an axis nothing was felt: there its own gain, or less.
    assert gains.gain[5] <= 0.03


def test_a_stiffness_that_no_following_bears_is_said(pa10):
    found = Environment(1e6, 1e3, 1e6, 0.0, 1.5, 3.84, (5.0, 15.0), 1e-5)
    gains = propose(pa10, found, Along.of("z"))
    assert gains.damping is None
    assert "none up to 10000 N·s/m" in report(pa10, found, gains)
    assert "sources.following" not in report(pa10, found, gains)


def test_a_press_that_the_cell_does_not_allow_is_bad_usage(pa10, capsys):
    press = Press(Along.of("z"), 0.02, 15.0)
    gentle = altered(pa10, {"sources.force.hold_threshold": 12.0})
    with pytest.raises(ConfigError, match="hold_threshold: value 12: a press of 15 N may reach"):
        allowed(gentle, press)
    free = altered(pa10, {"sources.force.gain": (7e-4, 7e-4, 0.0, 0.03, 0.03, 0.03)})
    with pytest.raises(ConfigError, match=r"sources.force.gain\[2\]: value 0"):
        allowed(free, press)
    command = ["identify", "pa10", "--environment", "--simulate"]
    assert main([*command, "--posture", "nowhere"]) == 2
    assert "nowhere" in capsys.readouterr().err
