import math

import pytest
from pydantic import ValidationError
from telerobot.config.errors import ConfigError
from telerobot.config.load import shipped
from telerobot.protocols import topics as t
from telerobot.tools.scripts.script import Script, Step, load_script


def write(tmp_path, text):
    path = tmp_path / "script.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", shipped("scripts"))
def test_every_shipped_script_is_sound_and_ends_after_its_last_step(name):
    script = load_script(name)
    assert script.description
    assert script.steps[-1].at_s < script.duration_s


def test_steps_come_in_order_of_time(tmp_path):
    steps = ("[[step]]\nat_s = 2\n'cmd/cancel' = {}", "[[step]]\nat_s = 1\n'operator/tare' = {}")
    text = "\n".join(("duration_s = 3", *steps))
    assert [step.at_s for step in load_script(write(tmp_path, text)).steps] == [1, 2]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("duration_s = ", "not TOML"),
        ("duration_s = 0", "duration_s: value 0"),
        ("duration_s = inf", "duration_s"),
        ("[[step]]\nat_s = 1", "duration_s"),
        ("duration_s = 1\nsteps = 2", "steps"),
        (
            "duration_s = 1\n[[step]]\nat_s = -1\n'cmd/cancel' = {}",
            "step[0].at_s (at_s = -1): value -1",
        ),
        (
            "duration_s = 1\n[[step]]\nat_s = 0\noperator = ''\n'cmd/cancel' = {}",
            "step[0].operator",
        ),
        ("duration_s = 1\n[[step]]\nat_s = 0", "one topic or one of silence, link, "),
        ("duration_s = 1\n[[step]]\nat_s = 0\njoystick = {}", "did you mean 'cmd/joystick'?"),
        ("duration_s = 1\n[[step]]\nat_s = 0\n'tlm/state' = {}", "tlm/state: neither a topic nor"),
        (
            "duration_s = 1\n[[step]]\nat_s = 0\n'cmd/cancel' = {}\n'operator/tare' = {}",
            "not cmd/cancel, operator/tare",
        ),
        (
            "duration_s = 1\n[[step]]\nat_s = 0.5\nfor_s = 1\n'cmd/cancel' = {}",
            "step[0] (at_s = 0.5): for_s: value 1: only a stream lasts",
        ),
        ("duration_s = 1\n[[step]]\nat_s = 0\nsilence = ['cmd/path']", "step[0].silence[0]"),
        (
            "duration_s = 1\n[[step]]\nat_s = 0\nlink = { loss = 2 }",
            "step[0].link.loss (at_s = 0): value 2: Input should be less than 1",
        ),
        ("duration_s = 1\n[[step]]\nat_s = 0\nmaster = {}", "step[0].master.twist"),
        (
            "duration_s = 1\n[[step]]\nat_s = 0\nraw = { topic = 'cmd/joystick', hex = 'zz' }",
            "step[0].raw.hex (at_s = 0): value zz",
        ),
        (
            "duration_s = 1\n[[step]]\nat_s = 0\nraw = { topic = 'cmd/nosuch', hex = '00' }",
            "step[0].raw.topic (at_s = 0): value cmd/nosuch",
        ),
        (
            "duration_s = 1\n[[step]]\nat_s = 0\nobstacle = { name = 'x', raduis = 1 }",
            "sensor/obstacle: raduis is not a field",
        ),
    ],
)
def test_a_mistake_is_one_line_that_names_file_and_key(tmp_path, text, words):
    path = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load_script(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert words in message
    assert "\n" not in message


def test_a_script_that_is_not_text_is_refused(tmp_path):
    path = tmp_path / "script.toml"
    path.write_bytes(b'description = "\xff"')
    with pytest.raises(ConfigError, match="not UTF-8"):
        load_script(path)


def test_a_script_that_is_not_there_is_named():
    with pytest.raises(ConfigError, match="no_such_script"):
        load_script("no_such_script")


@pytest.mark.parametrize(
    ("key", "fields", "words"),
    [
        ("operator/mode", {"action": "jump"}, "action: Input should be 'enable', "),
        ("operator/speed", {"factor": 5}, "factor: Input should be less than or equal to 1, not 5"),
        ("operator/speed", {"factor": "1"}, "factor: Input should be a valid number, not '1'"),
        ("operator/speed", {"factor": math.nan}, "factor: Input should be a finite number"),
        ("operator/speed", 0.5, "value 0.5: a table of fields is expected"),
        ("operator/tare", {"factor": 1}, "factor is not a field of this message"),
        ("cmd/joystick", {"twist": [1, 2]}, "twist[2]: the array is too short"),
        ("cmd/joystick", {}, "twist is missing"),
        ("cmd/joystick", {"twist": [11, 0, 0, 0, 0, 0]}, "less than or equal to 10, not 11"),
        ("cmd/position", {"xyz": [0, 0, 0]}, "rpy is missing"),
        ("cmd/position", {"xyz": [0] * 3, "rpy": [0] * 3, "speed": -1}, "speed: Input should be"),
        ("cmd/posture", {}, "give either posture or q"),
        ("cmd/jog", {"rates": []}, "rates: Tuple should have at least 1 item"),
        ("cmd/cancel", {"seen_tick": 3}, "seen_tick: is filled in by its sender"),
        ("operator/protective_stop", {"seal": "00"}, "seal: is filled in by its sender"),
        ("operator/mark", {"text": "clear\x1b[2J"}, "text: String should match pattern"),
        ("rig/fault", {"kind": "jump", "target": "j1"}, "kind: Input should be 'silence', "),
        ("rig/motion", {"target": "platform", "period_s": 0}, "period_s: Input should be greater"),
    ],
)
def test_a_step_is_judged_by_its_message_and_field_value_and_bound_are_named(key, fields, words):
    with pytest.raises(ValidationError) as caught:
        Step.model_validate({"at_s": 0, key: fields})
    (error,) = caught.value.errors()
    assert f"{key}: " in error["msg"]
    assert words in error["msg"]


HEARD = {t.Role.DAEMON, t.Role.RIG}
"""Who acts on what a script says; what only people look at is no step."""
SPOKEN = [x for x in t.TOPICS if x.flow.sender not in HEARD and HEARD & x.flow.receivers]


@pytest.mark.parametrize("topic", SPOKEN, ids=lambda topic: topic.key)
def test_every_topic_that_takes_commands_or_news_is_a_step(topic):
    """A new command needs its message and its row: here its message refuses by itself."""
    with pytest.raises(ValidationError, match=f"{topic.key}: .*(missing|nonsense is not a field)"):
        Step.model_validate({"at_s": 0, topic.key: {"nonsense": 1}})


def test_streams_of_two_tasks_end_each_in_its_own_time():
    stick = {"twist": [0.1, 0, 0, 0, 0, 0]}
    script = Script.model_validate(
        {
            "duration_s": 6.0,
            "step": [
                {"at_s": 0.0, "for_s": 2.0, "cmd/joystick": {"task": "left", **stick}},
                {"at_s": 0.0, "for_s": 5.0, "cmd/joystick": {"task": "right", **stick}},
                {"at_s": 1.0, "cmd/jog": {"mechanism": "left", "rates": [0.1]}},
                {"at_s": 4.0, "silence": ["cmd/jog:left"]},
            ],
        }
    )
    ends = [(step.at_s, step.silence) for step in script.steps if step.silence]
    assert ends == [
        (2.0, ("cmd/joystick:left",)),
        (4.0, ("cmd/jog:left",)),
        (5.0, ("cmd/joystick:right",)),
    ]
