"""A fault is explained by a touch just before it that nobody felt, and by its cause."""

from types import SimpleNamespace

import pytest
from telerobot.protocols.messages.telemetry import Event
from telerobot.tools.soak.cli import SINCE_S, Touches


def error(name, time_s, cause):
    values = {"cause": cause}
    return Event(id=1, tick=1, time_s=time_s, name=name, severity="error", values=values)


def watched(forces, *events, feels=(False,)):
    """Return the touches of a run with these forces [N] at these times [s], and its errors.

    `feels` tells of each arm of the cell whether it feels contact.
    """
    now, pressed = SimpleNamespace(time_s=0.0), SimpleNamespace(force=0.0)
    contacts = SimpleNamespace(greatest=lambda: pressed.force)
    world = SimpleNamespace(contacts=contacts)
    arms = [SimpleNamespace(config=SimpleNamespace(touch=touch or None)) for touch in feels]
    rig, cell = SimpleNamespace(world=world), SimpleNamespace(parts=arms)
    run = SimpleNamespace(cell=cell, rig=rig, clock=now, events=list(events))
    touches = Touches(run)
    for now.time_s, pressed.force in forces.items():
        run.on_physics(run)
    return touches


@pytest.mark.parametrize(
    ("event", "explained"),
    [
        (error("fault", 2.1, "following_error"), True),
        (error("fault", 2.0 + SINCE_S, "following_error"), True),
        (error("fault", 2.1 + SINCE_S, "following_error"), False),
        (error("fault", 1.9, "following_error"), False),
        (error("fault", 2.1, "bus_silent"), False),
        (error("fault", 2.1, None), False),
        (error("gate_refused", 2.1, "following_error"), False),
        (error("tick_raised", 2.1, "following_error"), False),
    ],
)
def test_a_touch_explains_a_joint_that_falls_behind_just_after_it(event, explained):
    touches = watched({1.0: 0.0, 2.0: 300.0, 3.0: 0.0}, event)
    assert touches.felt
    assert touches.most_n == 300.0
    assert (touches.unexplained() == []) is explained


def test_a_brush_holds_no_joint_up():
    touches = watched({2.0: 4.0}, error("fault", 2.1, "following_error"))
    assert not touches.felt
    assert len(touches.unexplained()) == 1


@pytest.mark.parametrize(
    ("feels", "explained"), [((True,), False), ((True, True), False), ((True, False), True)]
)
def test_where_contact_is_felt_no_touch_explains_a_fault(feels, explained):
    touches = watched({2.0: 300.0}, error("fault", 2.1, "following_error"), feels=feels)
    assert touches.felt
    assert (touches.unexplained() == []) is explained


def test_where_nobody_is_to_run_into_anything_no_touch_is_an_excuse():
    touches = watched({2.0: 300.0}, error("fault", 2.1, "following_error"))
    assert touches.unexplained() == []
    assert len(touches.unexplained(excused=False)) == 1
