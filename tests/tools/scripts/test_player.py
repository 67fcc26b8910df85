import tomllib

import pytest
from telerobot.protocols import topics as t
from telerobot.protocols.codec import decode_as
from telerobot.protocols.messages.perception import ObstacleNews
from telerobot.tools.scripts.player import Phase, Player
from telerobot.tools.scripts.script import Script


class Play:
    """A script played against a daemon of the tests, in virtual time."""

    def __init__(self, daemon, make_state, text):
        self.daemon, self.make_state = daemon, make_state
        self.faults = []
        script = Script.model_validate(tomllib.loads(text) if isinstance(text, str) else text)
        self.player = Player(script, "cell", daemon.put, daemon.ask, self.faults.append)
        self.ms = 0
        self.sent = []

    def until(self, end_s):
        while self.ms < 1000 * end_s and not self.player.over:
            if self.ms % 10 == 0:
                state = self.make_state(tick=self.ms // 10, mode=self.daemon.mode)
                self.player.operators.on_state(state)
            before = len(self.daemon.heard)
            self.player.run(self.ms / 1000)
            self.sent += [(self.ms / 1000, *heard) for heard in self.daemon.heard[before:]]
            self.ms += 1
        return self

    def times(self, topic):
        return [time for time, heard, _ in self.sent if heard is topic]


@pytest.fixture
def play(daemon, make_state):
    return lambda text: Play(daemon, make_state, text)


def test_the_operator_takes_the_lease_and_enables_before_time_starts(play, daemon):
    run = play(
        "duration_s = 1.0\n[[step]]\nat_s = 0.2\n'operator/mode' = { action = 'hold' }"
    ).until(3.0)
    assert run.player.phase is Phase.OVER
    assert [message.action for message in daemon.of(t.MODE)] == ["enable", "hold"]
    assert run.times(t.MODE)[1] == pytest.approx(run.player.start_s + 0.2, abs=2e-3)


def test_steps_are_played_in_order_of_time_whatever_their_order_in_the_file(play, daemon):
    text = """
        duration_s = 1.0
        [[step]]
        at_s = 0.5
        "operator/speed" = { factor = 0.5 }
        [[step]]
        at_s = 0.1
        "operator/speed" = { factor = 0.1 }
    """
    play(text).until(3.0)
    assert [message.factor for message in daemon.of(t.SPEED)] == [0.1, 0.5]


def test_a_stick_is_streamed_until_the_next_step_of_its_kind(play, daemon):
    run = play("""
        duration_s = 1.0
        [[step]]
        at_s = 0.0
        "cmd/joystick" = { twist = [0.1, 0, 0, 0, 0, 0] }
        [[step]]
        at_s = 0.5
        silence = ["cmd/joystick"]
    """).until(3.0)
    times = run.times(t.JOYSTICK)
    assert len(times) == pytest.approx(50, abs=1)
    assert times[-1] < run.player.start_s + 0.5


def test_what_is_refused_is_kept_with_time_and_reason(play, daemon):
    daemon.refusals["operator/speed"] = "out_of_range"
    run = play(
        "duration_s = 1.0\n[[step]]\nat_s = 0.25\n'operator/speed' = { factor = 0.5 }"
    ).until(3.0)
    assert run.player.phase is Phase.OVER
    assert run.player.refused == ["0.25 s: operator/speed: out_of_range: by the test"]


@pytest.mark.parametrize("key", ["operator/lease", "operator/mode"])
def test_a_refused_lease_or_enable_fails_the_script(play, daemon, key):
    daemon.refusals[key] = "not_today"
    run = play("duration_s = 1.0").until(3.0)
    assert run.player.phase is Phase.FAILED
    assert "not_today: by the test" in run.player.failure


def test_a_daemon_in_fault_fails_the_script(play, daemon):
    daemon.mode = "fault"
    run = play("duration_s = 1.0").until(3.0)
    assert run.player.failure == "the daemon is in FAULT: reset it first"


def test_without_auto_enable_time_starts_with_the_first_state(play, daemon):
    run = play("duration_s = 1.0\nauto_enable = false").until(3.0)
    assert run.player.phase is Phase.OVER
    assert daemon.heard == []


def test_a_second_operator_has_a_lease_and_numbers_of_its_own(play, daemon):
    play("""
        duration_s = 1.0
        [[step]]
        at_s = 0.1
        "operator/release" = {}
        [[step]]
        at_s = 0.2
        operator = "second"
        "operator/lease" = {}
        [[step]]
        at_s = 0.3
        operator = "second"
        "cmd/cancel" = {}
    """).until(3.0)
    assert [message.operator for message in daemon.of(t.LEASE)] == ["operator", "second"]
    (cancel,) = daemon.of(t.CANCEL)
    assert [proof.epoch for topic, proof in daemon.proofs if topic is t.CANCEL] == [2]
    assert cancel.seen_tick > 0


def test_a_command_without_the_lease_is_noted_not_raised(play, daemon):
    run = play("""
        duration_s = 0.5
        [[step]]
        at_s = 0.1
        operator = "second"
        "cmd/cancel" = {}
    """).until(3.0)
    assert run.player.refused == ["0.1 s: second holds no lease"]


def test_a_cut_link_carries_nothing_either_way(play, daemon):
    run = play("duration_s = 2.0\n[[step]]\nat_s = 1.0\nlink = { cut = true }").until(4.0)
    keepalives = run.times(t.KEEPALIVE)
    assert len(keepalives) == pytest.approx(10, abs=1)
    assert max(keepalives) <= run.player.start_s + 1.0
    assert run.player.client.seen_tick <= 100 * (run.player.start_s + 1.0)


def test_a_slow_link_delivers_everything_late_and_in_order(play, daemon):
    run = play("""
        duration_s = 2.0
        [[step]]
        at_s = 0.5
        link = { delay_s = 0.3 }
        [[step]]
        at_s = 1.0
        "cmd/cancel" = {}
    """).until(4.0)
    (cancelled,) = run.times(t.CANCEL)
    assert cancelled == pytest.approx(run.player.start_s + 1.3, abs=2e-3)
    numbers = daemon.numbers(t.KEEPALIVE)
    assert numbers == sorted(numbers)


def test_a_device_in_a_cell_that_reflects_no_forces_fails_the_script(play):
    run = play("duration_s = 1.0\n[[step]]\nat_s = 0.2\ndevice = { mode = 'rate' }").until(3.0)
    assert run.player.phase is Phase.FAILED
    assert run.player.failure == "0.2 s: device: the cell has no [reflection]"


def test_replies_are_late_as_well(play, daemon):
    run = play("duration_s = 0.1\n[network]\nrtt_s = 0.4").until(3.0)
    assert run.player.phase is Phase.OVER
    (enable,) = run.times(t.MODE)
    # a state comes, the request goes, its reply comes, and the next request goes
    assert enable == pytest.approx(4 * 0.2, abs=5e-3)


def test_faults_go_to_the_rig(play, daemon):
    run = play(
        "duration_s = 0.5\n[[step]]\nat_s = 0.1\n'rig/fault' = { kind = 'silence', target = 'j4' }"
    ).until(3.0)
    (fault,) = run.faults
    assert (fault.kind, fault.target, fault.on) == ("silence", "j4", True)


def test_raw_bytes_are_sent_as_they_are(play, daemon):
    raw = []
    daemon.put = lambda topic, payload, proof: raw.append((topic, payload))
    play("duration_s = 0.05\n[[step]]\nat_s = 0\nraw = { topic = 'cmd/jog', hex = '00ff' }").until(
        2
    )
    assert (t.JOG, b"\x00\xff") in raw


def test_a_stream_with_an_end_falls_silent_by_itself(play, daemon):
    run = play("""
        duration_s = 1.0
        [[step]]
        at_s = 0.1
        for_s = 0.3
        "cmd/jog" = { rates = [0.1] }
    """).until(3.0)
    times = run.times(t.JOG)
    assert len(times) == pytest.approx(30, abs=1)
    assert times[-1] < run.player.start_s + 0.4


def test_an_end_that_comes_after_the_next_step_of_its_stream_ends_nothing(play, daemon):
    run = play("""
        duration_s = 1.0
        [[step]]
        at_s = 0.1
        for_s = 0.5
        "cmd/jog" = { rates = [0.1] }
        [[step]]
        at_s = 0.4
        "cmd/jog" = { rates = [0.2] }
    """).until(3.0)
    assert run.times(t.JOG)[-1] > run.player.start_s + 0.95
    assert [message.rates for message in daemon.of(t.JOG)[-2:]] == [(0.2,), (0.2,)]


def test_every_topic_of_an_operator_is_a_step_with_its_messages_own_fields(play, daemon):
    steps = {
        "cmd/posture": {"posture": "ready"},
        "cmd/force": {"wrench": [1, 0, 0, 0, 0, 0], "expressed_in": "world"},
        "operator/clutch": {"engaged": True},
        "operator/protective_stop": {},
        "operator/protective_clear": {},
        "operator/tare": {},
    }
    script = {"duration_s": 1.0, "step": [{"at_s": 0.1, key: f} for key, f in steps.items()]}
    play(script).until(3.0)
    (posture,) = daemon.of(t.POSTURE)
    (force,) = daemon.of(t.FORCE)
    (clutch,) = daemon.of(t.CLUTCH)
    assert (posture.posture, force.wrench[0], force.expressed_in) == ("ready", 1.0, "world")
    assert clutch.engaged
    (stop,), (clear,) = daemon.of(t.PROTECTIVE_STOP), daemon.of(t.PROTECTIVE_CLEAR)
    assert stop.operator == clear.operator == "operator"
    assert len(daemon.of(t.TARE)) == 1


def test_news_of_a_sensor_carries_the_newest_tick_and_no_proof(play, daemon):
    told = []
    daemon.put = lambda topic, payload, proof: told.append((topic, payload, proof))
    play("""
        duration_s = 0.5
        [[step]]
        at_s = 0.2
        "sensor/obstacle" = { name = "ball", xyz = [1, 0, 0] }
    """).until(2.0)
    ((payload, proof),) = [
        (p, proof) for topic, p, proof in told if topic == t.OBSTACLE.by("script")
    ]
    news = decode_as(ObstacleNews, payload)
    assert (news.name, news.xyz, proof) == ("ball", (1.0, 0.0, 0.0), b"")
    assert news.tick > 0


@pytest.mark.parametrize(("tell", "physical"), [(True, True), (True, False), (False, True)])
def test_an_obstacle_that_moves_is_told_and_is_there_as_far_as_its_step_says(
    play, daemon, tell, physical
):
    told = []
    daemon.put = lambda topic, payload, proof: told.append((topic, payload))
    moving = {"name": "ball", "xyz": [1, 0, 0], "velocity": [0, 1, 0], "max_speed": 2.0}
    step = {"at_s": 0.1, "obstacle": {**moving, "tell": tell, "physical": physical}}
    run = play({"duration_s": 1.0, "step": [step]}).until(3.0)
    news = [
        decode_as(ObstacleNews, payload)
        for topic, payload in told
        if topic == t.OBSTACLE.by("script")
    ]
    assert [n.max_speed for n in news[:2]] == [2.0, None][: len(news)]
    assert len(news) == (pytest.approx(19, abs=1) if tell else 0)
    assert bool(run.faults) == physical
    for ys in ([n.xyz[1] for n in news], [fault.vector[1] for fault in run.faults]):
        assert ys == sorted(ys)
        assert not ys or ys[-1] == pytest.approx(0.9, abs=0.06)


# --- steps that wait ----------------------------------------------------------------------------

WAITS = """
    duration_s = 1.0
    [[step]]
    at_s = 0.2
    "operator/speed" = { factor = 0.5 }
    [[step]]
    at_s = 0.2
    until = { force_n = 5.0, timeout_s = 2.0 %s }
    [[step]]
    at_s = 0.3
    "operator/speed" = { factor = 0.1 }
"""
OTHERWISE = ', else = [{ at_s = 0.4, "operator/speed" = { factor = 0.9 } }]'


def felt(make_state, from_s, play):
    """Return states whose tool presses with 6 N from a time on, and that echo what was heard."""

    def made(**told):
        pressed = (6.0, 0.0, 0.0, 0.0, 0.0, 0.0) if play[0].ms >= 1000 * from_s else (0.0,) * 6
        heard = {"operator/speed": play[0].player.client.seq}
        return make_state(wrench_mrf=pressed, last_seq=heard, **told)

    return made


@pytest.fixture
def pressed(play, make_state):
    """Return what plays a script against a tool that presses from a time on."""

    def run(text, from_s, until_s=9.0):
        made = []
        made.append(play(text))
        made[0].make_state = felt(make_state, from_s, made)
        return made[0].until(until_s)

    return run


def test_the_scripts_time_stands_still_until_what_it_waits_for_is_so(pressed):
    run = pressed(WAITS % "", from_s=1.5)
    first, second = run.times(t.SPEED)
    assert first == pytest.approx(run.player.start_s + 0.2, abs=2e-3)
    assert second == pytest.approx(1.5 + 0.1, abs=0.015)
    assert run.player.phase is Phase.OVER
    assert run.ms / 1000 == pytest.approx(second + 0.7, abs=5e-3)


def test_what_is_waited_for_in_vain_fails_the_script_in_words(pressed):
    run = pressed(WAITS % "", from_s=99.0)
    assert run.player.phase is Phase.FAILED
    assert run.player.failure == "0.2 s: after 2 s: force_n: 0, at least 5 is expected"
    assert len(run.times(t.SPEED)) == 1


def test_or_else_other_steps_take_the_place_of_the_rest(pressed, daemon):
    run = pressed(WAITS % OTHERWISE, from_s=99.0)
    assert run.player.phase is Phase.OVER
    assert [message.factor for message in daemon.of(t.SPEED)] == [0.5, 0.9]
    first, second = run.times(t.SPEED)
    assert second - first == pytest.approx(2.0 + 0.4, abs=5e-3)


def test_a_state_that_has_not_heard_what_was_said_before_is_not_waited_on(play, make_state):
    run = play(WAITS % "")
    run.make_state = lambda **told: make_state(wrench_mrf=(6.0,) + (0.0,) * 5, last_seq={}, **told)
    assert run.until(9.0).player.failure == "0.2 s: after 2 s: not heard yet"


@pytest.mark.parametrize(
    ("wait", "words"),
    [
        ({"timeout_s": 1.0}, "something to wait for is expected"),
        ({"timeout_s": 1.0, "force_n": -1.0}, "greater than 0"),
        ({"force_n": 1.0}, "required"),
        (
            {
                "force_n": 1.0,
                "timeout_s": 1.0,
                "else": [{"at_s": 0.0, "until": {"at_goal": True, "timeout_s": 1.0}}],
            },
            "nothing of it in its else",
        ),
    ],
)
def test_a_wait_that_makes_no_sense_is_refused(wait, words):
    with pytest.raises(ValueError, match=words):
        Script.model_validate({"duration_s": 1.0, "step": [{"at_s": 0.0, "until": wait}]})
