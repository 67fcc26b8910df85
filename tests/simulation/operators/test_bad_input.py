"""What is malformed, late, unauthorised or out of range is refused by name; the arm goes on."""

import math
import struct

import msgpack
import numpy as np
import pytest
from telerobot.protocols.codec import encode
from telerobot.protocols.messages.messages import VERSION, JointJog, JoystickTwist, PositionTarget
from telerobot.server.commands.commands import Goals
from telerobot.server.commands.settings import OperatorSettings
from telerobot.server.operators.requests import ProtectiveStops
from telerobot.server.perception.obstacle_map import ObstacleMap
from telerobot.server.units.units import Units

from ..conftest import REST, STICK

TWIST = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]


def raw(at_s, payload, topic="cmd/joystick", proof="lease"):
    """Return a step in which the lease's holder sends bytes, or somebody with another proof."""
    return {"at_s": at_s, "raw": {"topic": topic, "hex": payload.hex(), "proof": proof}}


def forged(epoch, seq):
    return struct.pack(">QQ16s", epoch, seq, b"guess").hex()


def stick_map(**changes):
    fields = {
        "v": VERSION, "seen_tick": 10**6, "task": None,
        "twist": TWIST, "relative_to": "crf", "expressed_in": "crf", "handle": None,
    }  # fmt: skip
    return msgpack.packb(fields | changes)


BAD_BYTES = {
    "not_messagepack": b"\xc1",
    "not_a_map": msgpack.packb([1, 2]),
    "too_large": b"\x00" * 5000,
    "wrong_version": stick_map(v=VERSION + 1),
    "wrong_type": stick_map(twist="fast"),
    "unknown_field": stick_map(colour=1),
    "non_finite": stick_map(twist=[math.nan, 0.0, 0.0, 0.0, 0.0, 0.0]),
    "out_of_range": stick_map(twist=[99.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    "old_picture": stick_map(seen_tick=1),
    "future_picture": stick_map(seen_tick=10**7),
}


WRONG_PROOFS = {
    "wrong_proof": forged(epoch=1, seq=10**6),
    "old_epoch": forged(epoch=0, seq=10**6),
    "out_of_order": forged(epoch=1, seq=2**63 - 1),
}


@pytest.mark.parametrize("reason", BAD_BYTES | WRONG_PROOFS)
def test_a_bad_command_is_refused_by_name_and_changes_nothing(play, reason):
    stick = {"at_s": 0.3, "cmd/joystick": STICK}
    undisturbed = play(stick, seconds=1.6)
    bad = raw(1.2, BAD_BYTES.get(reason, stick_map()), proof=WRONG_PROOFS.get(reason, "lease"))
    disturbed = play(stick, bad, seconds=1.6)
    refusals = disturbed.events("command_refused")
    assert [e.values["reason"] for e in refusals] == [reason]
    assert disturbed.summary["command_hash"] == undisturbed.summary["command_hash"]


POST = {"name": "post", "shape": "sphere", "xyz": (2.0, 0.0, 1.0), "radius": 0.1}
HANDLERS = {
    "operator/switch": ({"source": "joystick", "on": False}, OperatorSettings, "switch"),
    "operator/tunnel": ({"pieces": []}, Units, "refitting"),
    "cmd/posture": ({"posture": "start"}, Goals, "take_posture"),
    "sensor/obstacle": (POST, ObstacleMap, "take"),
}


def fail(*_):
    raise KeyError("left out")


@pytest.mark.parametrize("topic", HANDLERS)
def test_a_message_whose_handler_raises_is_refused_and_the_arm_goes_on(play, monkeypatch, topic):
    fields, owner, handler = HANDLERS[topic]
    stick = {"at_s": 0.3, "cmd/joystick": STICK}
    undisturbed = play(stick, seconds=0.6)
    monkeypatch.setattr(owner, handler, fail)
    disturbed = play(stick, {"at_s": 0.4, topic: fields}, seconds=0.6)
    kind = "request" if topic.startswith("operator/") else "command"
    (refused,) = disturbed.events(f"{kind}_refused")
    assert (refused.values["topic"], refused.values["reason"]) == (topic, "handler_raised")
    assert "KeyError: 'left out' (test_bad_input.py:" in refused.detail
    assert disturbed.summary["mode"] == "enabled"
    assert disturbed.summary["command_hash"] == undisturbed.summary["command_hash"]


def test_an_obstacle_whose_news_raises_is_stale(play, monkeypatch):
    take, taken = ObstacleMap.take, []

    def fail_later(self, news, *more):
        taken.append(news)
        return take(self, news, *more) if len(taken) == 1 else fail()

    monkeypatch.setattr(ObstacleMap, "take", fail_later)
    told = [{"at_s": at_s, "sensor/obstacle": POST} for at_s in (0.2, 0.3)]
    run = play(*told, seconds=0.5)
    (stale,) = run.events("obstacle_stale")
    assert "post" in stale.detail
    assert "handler_raised" in stale.detail


def test_a_protective_stop_whose_handler_raises_stops_the_arm(play, monkeypatch):
    monkeypatch.setattr(ProtectiveStops, "latch", fail)
    run = play({"at_s": 0.3, "operator/protective_stop": {}}, seconds=0.6)
    assert run.summary["mode"] == "fault"
    assert [e.name for e in run.events("tick_raised")] == ["tick_raised"]


def test_a_flood_of_bad_commands_is_told_a_few_times_a_second(play):
    flood = [raw(0.5 + 0.01 * i, b"\xc1", proof="") for i in range(100)]
    run = play({"at_s": 0.3, "cmd/joystick": STICK}, *flood, seconds=2.0)
    refusals = run.events("command_refused")
    assert 1 <= len(refusals) <= 8
    assert run.summary["limit_violations"] == 0
    assert run.summary["mode"] == "enabled"


def test_a_target_of_too_many_joints_or_beyond_a_limit_is_refused_with_value_and_bound(play):
    run = play(
        {"at_s": 0.3, "cmd/posture": {"q": [0.0, 9.0, 0.0, 0.0, 0.0, 0.0, 0.0]}},
        {"at_s": 0.8, "cmd/posture": {"q": [0.0, 0.1]}},
        {"at_s": 1.3, "cmd/posture": {"posture": "sofa"}},
        {"at_s": 1.8, "cmd/jog": {"rates": [5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]}},
        {"at_s": 1.85, "silence": ["cmd/jog"]},
        seconds=2.2,
    )
    refusals = run.events("command_refused")
    assert [e.values["reason"] for e in refusals[:4]] == [
        "out_of_range", "wrong_joints", "unknown_posture", "out_of_range",
    ]  # fmt: skip
    assert "s2 9" in refusals[0].detail
    assert "1.57" in refusals[0].detail
    assert run.summary["command_hash"] == play(seconds=2.2).summary["command_hash"]


def test_nothing_sent_before_an_enable_is_ever_executed(play):
    """A target that was on its way when the arm was held arrives after the resume: it is dead."""
    run = play(
        {"at_s": 0.3, "operator/mode": {"action": "hold"}},
        {"at_s": 0.8, "operator/mode": {"action": "resume"}},
        seconds=1.5,
    )
    resumed = next(e for e in run.events("mode") if e.values["before"] == "hold")
    late = encode(
        PositionTarget(
            seen_tick=resumed.tick - 1,
            xyz=(0.1, 0.0, 0.0), rpy=(0.0, 0.0, 0.0), relative_to="mrf",
        )
    )  # fmt: skip
    again = play(
        {"at_s": 0.3, "operator/mode": {"action": "hold"}},
        {"at_s": 0.8, "operator/mode": {"action": "resume"}},
        raw(0.9, late, "cmd/position"),
        seconds=1.5,
    )
    assert [e.values["reason"] for e in again.events("command_refused")] == ["before_enable"]
    assert again.summary["command_hash"] == run.summary["command_hash"]


def test_what_was_ordered_before_a_hold_is_dead_after_the_resume(play):
    target = {"xyz": [0.0, 0.2, 0.0], "rpy": [0.0, 0.0, 0.0], "relative_to": "mrf"}
    run = play(
        {"at_s": 0.3, "cmd/position": target},
        {"at_s": 0.8, "operator/mode": {"action": "hold"}},
        {"at_s": 1.5, "operator/mode": {"action": "resume"}},
        seconds=3.0,
    )
    assert max(map(abs, run.at(0.75).dq_command)) > 0.01
    assert run.summary["mode"] == "enabled"
    assert run.states[-1].target_mrf is None
    moved = np.array(run.states[-1].pose_mrf[:3]) - run.at(1.4).pose_mrf[:3]
    assert np.linalg.norm(moved) < 2e-3


def test_commands_are_refused_while_the_arm_is_not_enabled(play):
    jog = encode(JointJog(seen_tick=10, rates=(0.1,) + (0.0,) * 6))
    run = play(
        {"at_s": 0.2, "operator/lease": {}},
        raw(0.3, jog, "cmd/jog"),
        seconds=1.0,
        auto_enable=False,
    )
    assert [e.values["reason"] for e in run.events("command_refused")] == ["not_enabled"]
    assert run.summary["mode"] == "ready"


def test_an_operator_that_is_cut_off_fades_and_then_the_arm_holds(play):
    run = play(
        {"at_s": 0.3, "cmd/joystick": STICK},
        {"at_s": 1.5, "link": {"cut": True}},
        seconds=4.0,
    )
    assert max(map(abs, run.at(1.45).dq_command)) > 0.01
    assert max(map(abs, run.at(2.0).dq_command)) < 0.3 * max(map(abs, run.at(1.45).dq_command))
    assert [e.detail for e in run.events("stream_expired")] == ["joystick"]
    assert run.events("lease_expired")
    assert run.summary["mode"] == "hold"
    assert run.summary["limit_violations"] == 0
    stopped = next(e for e in run.events("mode") if e.values["mode"] == "hold")
    assert stopped.time_s - run.simulation.player.start_s < 1.5 + 0.1 + 0.5 + 0.4


def test_an_operator_whose_link_delivers_everything_three_seconds_late_loses_the_arm(play):
    run = play(
        {"at_s": 0.3, "cmd/joystick": STICK},
        {"at_s": 1.0, "link": {"delay_s": 3.0}},
        seconds=8.0,
    )
    assert run.events("lease_expired")
    assert run.summary["mode"] == "hold"
    held = next(e for e in run.events("mode") if e.values["mode"] == "hold")
    after = [s.q_command for s in run.states if s.tick > held.tick]
    assert all(q == after[0] for q in after)
    assert {e.values["reason"] for e in run.events("command_refused")} <= {"no_lease"}


def test_in_order_delay_beyond_the_limit_is_noticed_while_the_lease_still_lives(play):
    run = play(
        {"at_s": 0.3, "cmd/joystick": STICK},
        {"at_s": 1.0, "link": {"delay_s": 0.3}},
        seconds=5.0,
    )
    assert "old_picture" in {e.values["reason"] for e in run.events("command_refused")}
    assert run.summary["mode"] == "hold"


def test_a_second_operator_is_refused_while_the_lease_lives_and_takes_over_after_release(play):
    run = play(
        {"at_s": 0.3, "cmd/joystick": STICK},
        {"at_s": 1.0, "operator": "second", "operator/lease": {}},
        {"at_s": 1.5, "operator/release": {}},
        {"at_s": 1.55, "operator": "second", "operator/lease": {}},
        {"at_s": 2.5, "operator": "second", "operator/mode": {"action": "resume"}},
        {"at_s": 2.7, "operator": "second", "cmd/joystick": {"twist": [0, -0.05, 0, 0, 0, 0]}},
        seconds=4.0,
    )
    assert [r for r in run.summary["refused"] if "lease_taken" in r]
    assert len(run.summary["refused"]) == 1
    assert run.at(2.4).mode == "hold"
    assert run.states[-1].lease_holder == "second"
    assert run.states[-1].lease_epoch == 2
    assert run.states[-1].twist[1] < 0.0
    assert run.summary["limit_violations"] == 0


def test_a_second_operator_takes_over_once_the_first_has_vanished(play):
    run = play(
        {"at_s": 0.3, "cmd/joystick": STICK},
        {"at_s": 1.0, "link": {"cut": True}},
        {"at_s": 2.5, "operator": "second", "operator/lease": {}},
        {"at_s": 2.6, "operator": "second", "operator/mode": {"action": "resume"}},
        {"at_s": 2.8, "operator": "second", "cmd/joystick": STICK},
        seconds=4.0,
    )
    assert run.summary["refused"] == []
    assert run.states[-1].lease_holder == "second"
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0


def test_a_protective_stop_needs_no_lease_is_latched_and_not_cleared_by_a_stranger(play):
    run = play(
        {"at_s": 0.3, "cmd/joystick": STICK},
        {"at_s": 1.0, "operator": "passer_by", "operator/protective_stop": {}},
        {"at_s": 1.6, "operator/mode": {"action": "resume"}},
        {"at_s": 1.8, "operator": "stranger", "operator/protective_clear": {}},
        {"at_s": 2.0, "operator": "passer_by", "operator/protective_clear": {}},
        {"at_s": 2.1, "operator/mode": {"action": "resume"}},
        {"at_s": 2.3, "cmd/joystick": REST},
        seconds=2.6,
    )
    assert run.at(1.5).mode == "hold"
    assert run.at(1.95).protective_stop
    assert ["protective_stop" in r or "not_yours" in r for r in run.summary["refused"]] == [
        True,
        True,
    ]
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0


def test_a_stick_message_of_the_newest_kind_is_what_the_tests_send():
    """The hand-made maps above are what the codec itself would send."""
    made = JoystickTwist(seen_tick=10**6, twist=tuple(TWIST))
    assert msgpack.unpackb(encode(made)) == msgpack.unpackb(stick_map())
