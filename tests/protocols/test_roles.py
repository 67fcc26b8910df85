"""Grants, as they stand in certificates, and what follows from them."""

import pytest
from telerobot.protocols.roles import Grant, Rights, rights
from telerobot.protocols.topics import OBSTACLE, TOPICS, Role


@pytest.mark.parametrize(
    "uri",
    ["telerobot:pa10/operator", "telerobot:pa10/sensor/vision", "telerobot:a/daemon"],
)
def test_a_grant_is_read_as_it_was_written(uri):
    assert Grant.parse(uri).uri == uri


@pytest.mark.parametrize(
    "uri",
    [
        "telerobot:pa10/sensor",
        "telerobot:pa10/sensor/*",
        "telerobot:pa10/sensor/nothing",
        "telerobot:pa10/cmd/joystick",
        "telerobot:pa10/operator/lease",
        "telerobot:pa10/operators",
        "telerobot:PA10/operator",
        "telerobot:*/operator",
        "telerobot:**/operator",
        "telerobot:pa10/operator\n",
        "telerobot:/operator",
        "https://pa10/operator",
        "",
    ],
)
def test_what_is_no_grant_grants_nothing(uri):
    assert Grant.parse(uri) is None


def test_who_has_no_grant_may_nothing():
    assert rights([]) == Rights()


def test_every_topic_has_one_who_sends_and_one_who_receives():
    every = [Grant("c", role) for role in Role if role is not Role.SENSOR]
    every += [Grant("c", Role.SENSOR, t.key) for t in TOPICS if t.key.startswith("sensor/")]
    may = rights(every)
    assert may.puts | may.asks == {topic.put_key("c") for topic in TOPICS}
    assert may.hears | may.answers == {topic.heard_key("c") for topic in TOPICS}


def test_a_sensor_tells_of_obstacles_under_its_own_name():
    grant = Grant("c", Role.SENSOR, OBSTACLE.key)
    plain = "telerobot/c/sensor/obstacle"
    assert rights([grant], "sensor-lidar").puts == {plain, f"{plain}/lidar"}
    assert rights([grant], "judge-c").puts == {plain, f"{plain}/judge-c"}
    assert rights([Grant("c", Role.SENSOR, "sensor/frame")], "sensor-lidar").puts == {
        "telerobot/c/sensor/frame"
    }


@pytest.mark.parametrize(
    ("key", "sender"),
    [
        ("telerobot/c/sensor/obstacle", ""),
        ("telerobot/c/sensor/obstacle/lidar", "lidar"),
        ("telerobot/c/sensor/obstacle/judge-c", "judge-c"),
        ("telerobot/c/sensor/obstacle/*", None),
        ("telerobot/c/sensor/obstacle/a/b", None),
        ("telerobot/c/sensor/obstacle_b", None),
        ("telerobot/c/sensor/*", None),
        ("x/telerobot/c/sensor/obstacle", None),
    ],
)
def test_a_key_names_its_sender_or_is_none_of_the_topic(key, sender):
    assert OBSTACLE.sender_on(key, "c") == sender


def test_nobody_hears_commands_or_writes_telemetry_but_the_daemon():
    for role in set(Role) - {Role.DAEMON}:
        may = rights([Grant("c", role, "sensor/vision" if role is Role.SENSOR else "")])
        assert not {key for key in may.hears if key.startswith("telerobot/c/cmd/")}
        assert not {key for key in may.puts if key.startswith("telerobot/c/tlm/")}
        assert not may.answers
