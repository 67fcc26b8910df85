import pytest
from telerobot.config.errors import ConfigError
from telerobot.config.load import shipped
from telerobot.tools.scripts.script import Step, load_script


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
    text = "duration_s = 3\n[[step]]\nat_s = 2\n[[step]]\nat_s = 1\ntare = true"
    assert [step.at_s for step in load_script(write(tmp_path, text)).steps] == [1, 2]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("duration_s = ", "not TOML"),
        ("duration_s = 0", "duration_s: value 0"),
        ("duration_s = inf", "duration_s"),
        ("[[step]]\nat_s = 1", "duration_s"),
        ("duration_s = 1\nsteps = 2", "steps"),
        ("duration_s = 1\n[[step]]\nat_s = -1", "step.0.at_s: value -1"),
        ("duration_s = 1\n[[step]]\nat_s = 0\nmode = 'jump'", "step.0.mode: value jump"),
        (
            "duration_s = 1\n[[step]]\nat_s = 0\nfault = { silence = 'j1', drop = 'j1' }",
            "one fault",
        ),
        ("duration_s = 1\n[[step]]\nat_s = 0\njoystick = { twist = [1, 2] }", "step.0.joystick"),
        ("duration_s = 1\n[[step]]\nat_s = 0\nposition = { xyz = [0, 0, 0] }", "rpy"),
        ("duration_s = 1\n[[step]]\nat_s = 0\nspeed = 5", "step.0.speed: value 5"),
        ("duration_s = 1\n[[step]]\nat_s = 0\noperator = ''", "step.0.operator"),
        ("duration_s = 1\n[[step]]\nat_s = 0\nposture = []", "step.0.posture"),
        ("duration_s = 1\n[[step]]\nat_s = 0\njog = { rates = [] }", "step.0.jog.rates"),
        (
            "duration_s = 1\n[[step]]\nat_s = 0\n"
            "position = { xyz = [0, 0, 0], rpy = [0, 0, 0], speed = -1 }",
            "step.0.position.speed: value -1",
        ),
        (
            "duration_s = 1\n[[step]]\nat_s = 0\nraw = { topic = 'cmd/joystick', hex = 'zz' }",
            "step.0.raw.hex: value zz",
        ),
        (
            "duration_s = 1\n[[step]]\nat_s = 0\nraw = { topic = 'cmd/nosuch', hex = '00' }",
            "step.0.raw.topic: value cmd/nosuch",
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


@pytest.mark.parametrize("spelling", [{"silence": "j4"}, {"kind": "silence", "target": "j4"}])
def test_a_fault_may_be_spelt_short_or_long(spelling):
    step = Step.model_validate({"at_s": 0, "fault": spelling})
    assert (step.fault.kind, step.fault.target, step.fault.on) == ("silence", "j4", True)
