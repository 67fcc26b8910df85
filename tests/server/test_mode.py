from itertools import product

import pytest
from telerobot.server.mode import Mode, ModeInputs, PendingAction, next_mode

CALM = ModeInputs(
    action=PendingAction.NONE, hold=False, resume=False, open=True, healthy=True,
    drives_enabled=False, drives_off=True, may_move=False, at_rest=True,
)  # fmt: skip
"""Nobody asks for anything, all is well, and nobody may move."""
DRIVEN = CALM._replace(drives_enabled=True, drives_off=False, may_move=True, at_rest=False)
"""An operator drives."""


def after(mode, situation=CALM, **changes):
    return next_mode(mode, situation._replace(**changes))


@pytest.mark.parametrize(
    ("mode", "situation", "changes", "expected"),
    [
        (Mode.BOOT, CALM, {}, Mode.READY),
        (Mode.READY, DRIVEN, {"action": PendingAction.ENABLE}, Mode.ENABLED),
        (Mode.ENABLED, DRIVEN, {"hold": True}, Mode.STOPPING),
        (Mode.ENABLED, DRIVEN, {"action": PendingAction.DISABLE}, Mode.STOPPING),
        (Mode.ENABLED, DRIVEN, {"may_move": False}, Mode.STOPPING),
        (Mode.STOPPING, DRIVEN, {"at_rest": True}, Mode.HOLD),
        (Mode.HOLD, DRIVEN, {"resume": True}, Mode.ENABLED),
        (Mode.HOLD, DRIVEN, {"action": PendingAction.DISABLE}, Mode.READY),
        (Mode.HOLD, DRIVEN, {"action": PendingAction.DISABLE, "may_move": False}, Mode.READY),
        (Mode.FAULT, CALM, {"action": PendingAction.RESET}, Mode.READY),
    ],
)
def test_each_transition_of_the_drawing(mode, situation, changes, expected):
    assert after(mode, situation, **changes) is expected


@pytest.mark.parametrize(
    ("mode", "situation", "changes"),
    [
        (Mode.BOOT, CALM, {"open": False}),
        (Mode.READY, DRIVEN, {}),
        (Mode.READY, DRIVEN, {"action": PendingAction.ENABLE, "drives_enabled": False}),
        (Mode.READY, DRIVEN, {"action": PendingAction.ENABLE, "may_move": False}),
        (Mode.READY, DRIVEN, {"resume": True}),
        (Mode.READY, DRIVEN, {"action": PendingAction.DISABLE}),
        (Mode.READY, DRIVEN, {"action": PendingAction.RESET}),
        (Mode.ENABLED, DRIVEN, {}),
        (Mode.ENABLED, DRIVEN, {"at_rest": True}),
        (Mode.ENABLED, DRIVEN, {"resume": True}),
        (Mode.STOPPING, DRIVEN, {}),
        (Mode.STOPPING, DRIVEN, {"resume": True}),
        (Mode.STOPPING, DRIVEN, {"action": PendingAction.DISABLE}),
        (Mode.HOLD, DRIVEN, {}),
        (Mode.HOLD, DRIVEN, {"resume": True, "may_move": False}),
        (Mode.HOLD, DRIVEN, {"resume": True, "hold": True}),
        (Mode.HOLD, DRIVEN, {"action": PendingAction.ENABLE}),
        (Mode.FAULT, CALM, {}),
        (Mode.FAULT, CALM, {"action": PendingAction.ENABLE}),
        (Mode.FAULT, CALM, {"resume": True}),
        (Mode.FAULT, CALM, {"action": PendingAction.RESET, "healthy": False}),
        (Mode.FAULT, CALM, {"action": PendingAction.RESET, "open": False}),
        (Mode.FAULT, CALM, {"action": PendingAction.RESET, "drives_off": False}),
    ],
)
def test_what_must_not_change_the_mode(mode, situation, changes):
    assert after(mode, situation, **changes) is mode


def every_situation():
    flags = [name for name in ModeInputs._fields if name != "action"]
    for action, *values in product(PendingAction, *[(False, True)] * len(flags)):
        yield ModeInputs(action=action, **dict(zip(flags, values, strict=True)))


def test_in_no_situation_does_the_mode_change_along_an_arrow_that_is_not_drawn():
    drawn = {
        (Mode.BOOT, Mode.READY),
        (Mode.READY, Mode.ENABLED),
        (Mode.ENABLED, Mode.STOPPING),
        (Mode.STOPPING, Mode.HOLD),
        (Mode.HOLD, Mode.ENABLED),
        (Mode.HOLD, Mode.READY),
        (Mode.FAULT, Mode.READY),
    }
    stay = {(mode, mode) for mode in Mode}
    fault = {(mode, Mode.FAULT) for mode in Mode}
    found = {(mode, next_mode(mode, s)) for mode in Mode for s in every_situation()}
    assert found == drawn | stay | fault


def test_whatever_is_asked_trouble_ends_in_fault_from_anywhere():
    for mode, s in product(Mode, every_situation()):
        if not s.healthy:
            assert next_mode(mode, s) is Mode.FAULT


def test_nobody_becomes_or_stays_enabled_who_may_not_move():
    for mode, s in product(Mode, every_situation()):
        if not s.may_move:
            assert next_mode(mode, s) is not Mode.ENABLED


def test_drives_are_on_in_three_modes():
    assert {m for m in Mode if m.energised} == {Mode.ENABLED, Mode.STOPPING, Mode.HOLD}
