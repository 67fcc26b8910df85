"""What the teleop says of what happened."""

from types import SimpleNamespace

import pytest
from telerobot.protocols.messages.telemetry import Description, Event, TaskDescription
from telerobot.tools.operator.terminal import KeyboardTeleop
from telerobot.tools.operator.words import event_line


@pytest.mark.parametrize(
    ("detail", "values", "line"),
    [
        ("", {}, "The posture is reached."),
        ("by ann", {"by": "ann"}, "The posture is reached. (by ann)"),
        ("", {"epoch": 1}, "The posture is reached. epoch=1"),
    ],
)
def test_an_event_is_a_line_that_says_nothing_twice(detail, values, line):
    event = Event(
        id=1,
        tick=1,
        time_s=2.5,
        name="posture_reached",
        severity="info",
        detail=detail,
        values=values,
    )
    assert event_line(event).strip() == f"2.50 s posture_reached: {line}"


class Client:
    """A client that holds the lease, and keeps what it is told."""

    name = "ann"

    def __init__(self):
        self.streams, self.said = {}, []

    def stream(self, topic, **fields):
        self.streams[topic.key] = fields

    def end_stream(self, topic):
        self.streams.pop(topic.key, None)

    def command(self, topic, **fields):
        self.said.append((topic.key, fields))

    def request(self, topic, on_reply, **fields):
        self.said.append((topic.key, fields))

    def acquire(self, on_reply):
        self.said.append("acquire")

    def release(self, on_reply):
        self.said.append("release")


def described(*names):
    tasks = [
        TaskDescription.model_construct(
            task=name,
            mechanism=f"arm_{name}",
            joints=("j1", "j2"),
            max_velocity=(1.0, 2.0),
            insertion={"speed": 0.08, "depth": 0.9} if name == "snake" else None,
            self_motion={"arm_angle": 0.15} if name == "elbow" else None,
        )
        for name in names
    ]
    return Description.model_construct(**tasks[0].__dict__, tasks=tuple(tasks[1:]))


def keys(*names, holding=None, holder="ann"):
    """Return a keyboard's teleop over a cell with those tasks, its client, and what it says."""
    client, lines = Client(), []
    operator = SimpleNamespace(
        client=client,
        state=SimpleNamespace(
            mode="enabled",
            q=(0.0,) * 4,
            of=lambda _task: SimpleNamespace(held_by=holding),
            lease_holder=holder,
        ),
        holds_lease=True,
        description=described(*names),
    )
    return KeyboardTeleop(operator, lines.append), client, lines


def test_a_key_changes_hands_and_the_arm_that_was_led_stands():
    teleop, client, lines = keys("left", "right")
    teleop.press("w", 0.0)
    teleop.run(0.0)
    assert client.streams["cmd/joystick"]["task"] == "left"
    teleop.press("y", 0.1)
    assert client.streams == {}
    assert lines[-1] == "the keys lead right"
    teleop.press("w", 0.2)
    teleop.run(0.2)
    assert client.streams["cmd/joystick"]["task"] == "right"
    for key in ("2", "up"):
        teleop.press(key, 0.3)
    teleop.run(0.3)
    assert client.streams["cmd/jog"]["mechanism"] == "arm_right"
    teleop.press("p", 0.4)
    assert client.said[-1] == ("cmd/posture", {"posture": "ready", "mechanism": "arm_right"})
    teleop.press("y", 0.5)
    assert lines[-1] == "the keys lead left"


@pytest.mark.parametrize(("holder", "asked"), [("ann", "release"), (None, "acquire")])
def test_a_lease_that_a_new_daemon_never_gave_is_asked_for_and_not_released(holder, asked):
    teleop, client, _ = keys("arm", holder=holder)
    teleop.press("L", 0.0)
    assert client.said == [asked]


def test_with_one_arm_nothing_names_it():
    teleop, client, lines = keys("arm")
    teleop.press("y", 0.0)
    assert lines == ["the cell has one arm"]
    teleop.press("w", 0.0)
    teleop.run(0.0)
    assert set(client.streams["cmd/joystick"]) == {"twist", "expressed_in"}


def test_held_keys_insert_and_withdraw_an_arm_in_tunnels_at_its_speed_at_most():
    teleop, client, lines = keys("snake")
    teleop.help()
    assert lines[-1] == " v b  insert, withdraw while held"
    teleop.press("v", 0.0)
    teleop.run(0.0)
    assert client.streams["cmd/drive"] == {"rates": (0.05,)}
    for _ in range(3):
        teleop.press("+", 0.1)
    teleop.press("b", 0.2)
    teleop.run(0.2)
    assert client.streams["cmd/drive"] == {"rates": (-0.08,)}
    for key in ("2", "up"):
        teleop.press(key, 0.3)
    teleop.run(0.3)
    assert set(client.streams) == {"cmd/jog"}


def test_held_keys_move_the_spare_joints_of_an_arm_that_has_some_and_the_stick_beside():
    teleop, client, lines = keys("elbow")
    teleop.help()
    assert "spare joints" in lines[-1]
    for key in ("w", "z"):
        teleop.press(key, 0.0)
    teleop.run(0.0)
    assert client.streams["cmd/self_motion"] == {"rate": 0.15}
    assert any(client.streams["cmd/joystick"]["twist"])
    teleop.press("Z", 0.1)
    teleop.run(0.1)
    assert client.streams["cmd/self_motion"] == {"rate": -0.15}
    for key in ("2", "up"):
        teleop.press(key, 0.3)
    teleop.run(0.3)
    assert set(client.streams) == {"cmd/jog"}


def test_an_arm_without_spare_joints_says_so():
    teleop, client, lines = keys("arm")
    teleop.press("z", 0.0)
    teleop.run(0.0)
    assert lines == ["the arm has no spare joint: its task holds them all"]
    assert set(client.streams) == {"cmd/joystick"}


def test_an_arm_without_tunnels_is_not_driven():
    teleop, client, lines = keys("arm")
    teleop.press("v", 0.0)
    teleop.run(0.0)
    assert set(client.streams) == {"cmd/joystick"}
    teleop.help()
    assert not any("insert" in line for line in lines)


def test_keys_for_an_arm_that_holds_a_payload_with_others_lead_all_of_them():
    teleop, client, lines = keys("left", "right", "beam", holding="beam")
    teleop.press("w", 0.0)
    teleop.run(0.05)
    assert client.streams["cmd/joystick"]["task"] == "beam"
    teleop.press("y", 0.1)
    assert lines[-1] == "the keys lead beam"


def test_the_status_is_shown_before_the_description_has_come(make_state):
    operator = SimpleNamespace(
        client=Client(),
        state=make_state(mode="ready"),
        state_since_s=0.0,
        holds_lease=False,
        description=None,
        round_trip=SimpleNamespace(seconds=None, heard_s=None),
    )
    arm, _ = KeyboardTeleop(operator, print).lines(0.1)
    assert arm.startswith("READY | xyz")
