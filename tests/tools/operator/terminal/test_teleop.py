"""What the teleop says of what happened."""

import pytest
from telerobot.protocols.messages.telemetry import Event
from telerobot.tools.operator.terminal.teleop import event_line


@pytest.mark.parametrize(
    ("detail", "values", "line"),
    [
        ("", {}, "2.50 s posture_reached"),
        ("ready -> enabled", {"mode": "enabled"}, "2.50 s posture_reached: ready -> enabled"),
        ("", {"epoch": 1}, "2.50 s posture_reached epoch=1"),
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
    assert event_line(event).strip() == line
