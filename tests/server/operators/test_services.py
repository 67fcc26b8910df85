import itertools
from dataclasses import dataclass, field, replace
from hashlib import sha256
from types import SimpleNamespace

import numpy as np
import pytest
from telerobot.protocols import topics as t
from telerobot.protocols.codec import decode_as, encode
from telerobot.protocols.messages import messages as m
from telerobot.protocols.messages import requests
from telerobot.protocols.proof import KeyPair, prove
from telerobot.server.commands.commands import Commands
from telerobot.server.control.spatial import Pose
from telerobot.server.control.tick import Control
from telerobot.server.events import Events
from telerobot.server.mode import Mode, PendingAction
from telerobot.server.operators.admission import Admission, Grants, Instant
from telerobot.server.operators.inbox import QueuedMessage, refusal_reply
from telerobot.server.operators.requests import ENABLE_TIMEOUT_S, RequestContext, Services
from telerobot.server.refusals import Refused, Why
from telerobot.server.units.units import Units
from telerobot.tools.simulation.simulation import seeded_keys

CELL = "cell"
OPENS = b"o" * 32
SEAL = sha256(OPENS).digest()


@dataclass
class Counter:
    """A desk with everything behind it, and an operator in front of it."""

    services: Services
    admission: Admission
    commands: Commands
    events: Events
    context: RequestContext
    replies: list[requests.Reply] = field(default_factory=list)
    seq: int = 0
    secret: bytes = b""
    keys: itertools.count = field(default_factory=lambda: itertools.count(1))

    def ask(self, topic, **fields):
        """Ask as the lease's holder; return the answer, or None while it waits."""
        if issubclass(topic.message, m.Command):
            fields = {"seen_tick": self.context.now.tick, **fields}
            return self.ask_proving(topic, **fields)
        return self.put(topic, encode(topic.message(**fields)))

    def ask_proving(self, topic, secret=None, **fields):
        """Ask with a proof of the lease, by its secret or another."""
        self.seq += 1
        payload, key = encode(topic.message(**fields)), topic.full_key(CELL)
        epoch = self.admission.lease.epoch
        return self.put(topic, payload, prove(secret or self.secret, key, epoch, self.seq, payload))

    def put(self, topic, payload, proof=b""):
        before = len(self.replies)
        answer = lambda reply: self.replies.append(decode_as(requests.Reply, reply))  # noqa: E731
        try:
            proven = (
                self.admission.prove(topic, payload, proof, self.context.now) if proof else None
            )
        except Refused as refused:
            return refusal_reply(refused, self.context.now)
        self.services.serve(QueuedMessage(topic, payload, proven, answer), self.context)
        return self.replies[-1] if len(self.replies) > before else None

    def lease(self, operator="ann"):
        pair = KeyPair(bytes([next(self.keys)]) * 32)
        reply = self.ask(t.LEASE, operator=operator, key=pair.public)
        if reply.ok:
            lease_key = t.LEASE.full_key(CELL)
            self.secret = pair.agree_with_daemon(reply.key, lease_key, reply.epoch)
        return reply

    def see(self, **changes):
        self.context = replace(self.context, **changes)

    def sense(self, **changes):
        """Let the force/torque monitor say something else."""
        vars(self.context.units.each[0].perception.sensor).update(changes)

    def pass_time(self, seconds, mode=None):
        """Let time go by, with the lease kept alive; settle in a mode."""
        now = self.context.now
        self.see(now=Instant(now.time_s + seconds, now.tick + round(100 * seconds), None))
        self.admission.renew(self.context.now)
        if mode is not None:
            self.see(mode=mode)
        self.services.modes.begin_tick()
        self.services.modes.settle(self.context.mode, self.context)


@pytest.fixture
def counter(pa10):
    admission, events = Admission(CELL, 0.01, 0.5, 0.5), Events()
    units = Units.from_cell(pa10.cell, Control.of(pa10.cell), events)
    (unit,) = units.each
    unit.perception.sensor = SimpleNamespace(
        unloaded=np.arange(6.0), still=True, stale=False, essential=True
    )
    unit.output = SimpleNamespace(
        T_world_mrf=Pose.identity(), T_wrist_mrf=unit.commands.frames.T_wrist_mrf
    )
    grants = Grants(CELL, admission, seeded_keys("daemon"))
    context = RequestContext(Instant(10.0, 1000, None), Mode.READY, units)
    services = Services(admission, events, grants)
    return Counter(services, admission, unit.commands, events, context)


@pytest.fixture
def ann(counter):
    """The counter with ann's lease."""
    assert counter.lease().ok
    return counter


def names(counter):
    return [e.name for e in counter.events.take()]


# --- the lease ------------------------------------------------------------------------------------


def test_the_lease_is_granted_with_a_secret_that_both_sides_know_and_neither_sends(counter):
    reply = counter.lease("ann")
    assert reply.ok
    assert reply.epoch == 1
    lease = counter.admission.lease
    assert (lease.holder, lease.secret) == ("ann", counter.secret)
    assert lease.secret not in encode(reply)
    assert names(counter) == ["lease_granted"]


def test_a_second_operator_is_told_who_holds_the_lease_and_gets_no_key(ann):
    reply = ann.lease("bob")
    assert (reply.ok, reply.reason, reply.key) == (False, Why.LEASE_TAKEN, None)
    assert "ann" in reply.detail
    assert ann.admission.lease.holder == "ann"


def test_a_key_that_makes_no_secret_is_refused_and_the_lease_stays_free(counter):
    reply = counter.ask(t.LEASE, operator="ann", key=bytes(32))
    assert (reply.ok, reply.reason) == (False, Why.WRONG_KEY)
    assert counter.admission.lease.holder is None


def test_what_is_given_back_can_be_taken_at_once_and_the_old_secret_is_dead(ann):
    old = ann.secret
    assert ann.ask(t.RELEASE).ok
    assert ann.lease("bob").epoch == 2
    reply = ann.ask(t.SPEED, factor=0.5, secret=old)
    assert (reply.ok, reply.reason) == (False, Why.WRONG_PROOF)


def test_secrets_are_in_no_event(ann):
    ann.ask(t.SPEED, factor=0.5, secret=b"s" * 32)
    ann.lease("bob")
    told = " ".join(str(e) for e in ann.events.take())
    assert ann.secret.hex() not in told
    assert str(ann.secret) not in told


@pytest.mark.parametrize("topic", [t.MODE, t.GAIN, t.SWITCH, t.FRAME, t.SPEED, t.TARE, t.RELEASE])
def test_without_the_lease_nothing_is_changed(counter, topic):
    fields = {
        t.MODE: {"action": "enable"},
        t.GAIN: {"source": "joystick", "gain": (2.0,) * 6},
        t.SWITCH: {"source": "joystick", "on": False},
        t.FRAME: {"frame": "mrf", "xyz": (0, 0, 0.1), "rpy": (0, 0, 0)},
        t.SPEED: {"factor": 0.5},
    }.get(topic, {})
    before = counter.commands.settings.for_control()
    reply = counter.ask(topic, **fields)
    assert (reply.ok, reply.reason) == (False, Why.NO_LEASE)
    assert counter.services.modes.action is PendingAction.NONE
    after = counter.commands.settings.for_control()
    assert after.speed_factor == before.speed_factor
    assert after.T_wrist_mrf is before.T_wrist_mrf
    np.testing.assert_array_equal(after.gains["joystick"], before.gains["joystick"])
    np.testing.assert_array_equal(after.wrench_bias, before.wrench_bias)


def test_rubbish_is_answered_too(counter):
    reply = counter.put(t.LEASE, b"\xff\x00")
    assert not reply.ok
    assert reply.reason
    assert names(counter) == ["request_refused"]


# --- a tunnel -------------------------------------------------------------------------------------


def tell(counter, parts, **context):
    """Tell a tunnel to which joints are fitted in so many parts; return a first answer, if any."""
    counter.see(units=SimpleNamespace(refitting=lambda _: iter([None] * parts)), **context)
    return counter.ask(t.TUNNEL, pieces=[(0.5, 0.0, 0.0, 0.0)])


def go_on(counter):
    counter.services.tunnels.go_on(counter.context)
    return counter.replies[-1]


def test_a_tunnel_is_answered_once_joints_are_fitted_to_it_a_part_in_each_period(ann):
    assert tell(ann, 3, mode=Mode.ENABLED, drives_off=False) is None
    waits = [go_on(ann).epoch for _ in range(3)]
    assert waits == [1, 1, 1]  # the newest answer is that of the lease
    again = ann.ask(t.TUNNEL, pieces=[])
    assert (again.ok, again.reason) == (False, Why.NOT_NOW)
    assert go_on(ann).ok
    assert len(ann.replies) == 3
    assert tell(ann, 0) is None
    assert go_on(ann).ok


def test_with_drives_off_many_parts_are_fitted_in_a_period_but_never_a_heartbeats_worth(ann):
    tell(ann, 150, mode=Mode.READY, drives_off=True)
    assert [go_on(ann).epoch for _ in range(2)] == [1, 1]
    assert go_on(ann).ok
    assert go_on(ann).epoch is None


def test_with_drives_off_joints_are_fitted_to_a_tunnel_at_once(ann):
    tell(ann, 50, mode=Mode.READY, drives_off=True)
    assert go_on(ann).epoch is None
    assert ann.replies[-1].ok


@pytest.mark.parametrize(
    ("happens", "reason"),
    [
        (lambda ann: ann.see(mode=Mode.FAULT), Why.NOT_NOW),
        (lambda ann: ann.admission.end(), Why.NO_LEASE),
    ],
)
def test_a_tunnel_whose_operator_is_gone_or_whose_arm_fails_meanwhile_is_refused(
    ann, happens, reason
):
    tell(ann, 3, mode=Mode.HOLD, drives_off=False)
    go_on(ann)
    happens(ann)
    reply = go_on(ann)
    assert (reply.ok, reply.reason) == (False, reason)
    assert names(ann)[-1] == "request_refused"
    happens(ann)
    assert go_on(ann) is reply  # and nothing goes on


# --- modes ----------------------------------------------------------------------------------------


def test_enable_is_answered_when_the_arm_is_enabled(ann):
    assert ann.ask(t.MODE, action="enable") is None
    assert ann.services.modes.action is PendingAction.ENABLE
    ann.pass_time(0.5)
    assert len(ann.replies) == 1
    ann.pass_time(0.1, Mode.ENABLED)
    assert ann.replies[-1].ok
    assert ann.replies[-1].tick == ann.context.now.tick
    assert ann.services.modes.action is PendingAction.NONE


def test_drives_that_do_not_come_up_are_not_waited_for_for_ever(ann):
    ann.ask(t.MODE, action="enable")
    ann.pass_time(ENABLE_TIMEOUT_S - 0.1)
    assert ann.services.modes.action is PendingAction.ENABLE
    ann.pass_time(0.2)
    reply = ann.replies[-1]
    assert (reply.ok, reply.reason) == (False, Why.STILL_WRONG)
    assert ann.services.modes.action is PendingAction.NONE
    assert "enable_failed" in names(ann)


def test_a_fault_on_the_way_ends_the_wish_to_enable(ann):
    ann.ask(t.MODE, action="enable")
    ann.pass_time(0.1, Mode.FAULT)
    reply = ann.replies[-1]
    assert (reply.ok, reply.reason) == (False, Why.NOT_NOW)
    assert ann.services.modes.action is PendingAction.NONE


@pytest.mark.parametrize(
    ("action", "mode", "reached"),
    [("disable", Mode.ENABLED, Mode.READY), ("reset", Mode.FAULT, Mode.READY)],
)
def test_disable_and_reset_are_answered_once_ready(ann, action, mode, reached):
    ann.see(mode=mode)
    assert ann.ask(t.MODE, action=action) is None
    ann.pass_time(0.1)
    assert len(ann.replies) == 1
    ann.pass_time(0.1, reached)
    assert ann.replies[-1].ok


@pytest.mark.parametrize("action", ["resume", "enable"])
def test_resume_is_a_wish_of_one_tick(ann, action):
    ann.see(mode=Mode.HOLD)
    assert ann.ask(t.MODE, action=action).ok
    assert ann.services.modes.resume
    ann.services.modes.begin_tick()
    assert not ann.services.modes.resume
    assert ann.services.modes.action is PendingAction.NONE


def test_hold_is_at_once_and_for_one_tick(ann):
    ann.see(mode=Mode.ENABLED)
    assert ann.ask(t.MODE, action="hold").ok
    assert ann.services.modes.hold
    ann.services.modes.begin_tick()
    assert not ann.services.modes.hold


@pytest.mark.parametrize(
    ("action", "modes"),
    [
        ("enable", {Mode.READY, Mode.HOLD}),
        ("hold", {Mode.ENABLED, Mode.STOPPING, Mode.HOLD}),
        ("resume", {Mode.HOLD}),
        ("disable", {Mode.ENABLED, Mode.STOPPING, Mode.HOLD}),
        ("reset", {Mode.FAULT}),
    ],
)
def test_each_action_is_refused_in_every_mode_but_its_own(ann, action, modes):
    for mode in set(Mode) - modes:
        ann.see(mode=mode)
        reply = ann.ask(t.MODE, action=action)
        assert (reply.ok, reply.reason) == (False, Why.NOT_NOW)
        assert mode in reply.detail
    assert ann.services.modes.action is PendingAction.NONE
    assert not ann.services.modes.hold
    assert not ann.services.modes.resume


def test_one_wish_at_a_time(ann):
    ann.ask(t.MODE, action="enable")
    reply = ann.ask(t.MODE, action="enable")
    assert (reply.ok, reply.reason) == (False, Why.NOT_NOW)
    ann.pass_time(0.1, Mode.ENABLED)
    assert [r.ok for r in ann.replies] == [True, False, True]


def test_a_disable_is_answered_once_the_drives_have_said_that_they_are_off(ann):
    ann.see(mode=Mode.HOLD)
    assert ann.ask(t.MODE, action="disable") is None
    ann.see(drives_off=False)
    ann.pass_time(0.1, Mode.READY)
    assert len(ann.replies) == 1
    ann.see(drives_off=True)
    ann.pass_time(0.1)
    assert ann.replies[-1].ok


def test_a_disable_takes_the_place_of_an_enable_that_is_under_way(ann):
    assert ann.ask(t.MODE, action="enable") is None
    ann.see(drives_off=False)
    ann.ask(t.MODE, action="disable")
    assert ann.services.modes.action is PendingAction.DISABLE
    assert [(r.ok, r.reason) for r in ann.replies[1:]] == [(False, Why.NOT_NOW)]
    ann.see(drives_off=True)
    ann.pass_time(0.1)
    assert ann.replies[-1].ok


def test_an_enable_while_drives_switch_off_is_taken_and_waits(ann):
    ann.see(mode=Mode.HOLD)
    ann.ask(t.MODE, action="disable")
    ann.see(drives_off=False)
    ann.pass_time(0.02, Mode.READY)
    ann.ask(t.MODE, action="enable")
    assert ann.services.modes.action is PendingAction.ENABLE
    assert [r.ok for r in ann.replies[1:]] == [True]
    ann.pass_time(0.2, Mode.ENABLED)
    assert [r.ok for r in ann.replies[1:]] == [True, True]


def test_a_fault_ends_the_wish_to_disable_so_that_a_reset_need_not_wait(ann):
    ann.see(mode=Mode.ENABLED)
    ann.ask(t.MODE, action="disable")
    ann.pass_time(0.02, Mode.FAULT)
    assert (ann.replies[-1].ok, ann.replies[-1].reason) == (False, Why.NOT_NOW)
    assert ann.ask(t.MODE, action="reset") is None
    assert ann.services.modes.action is PendingAction.RESET


@pytest.mark.parametrize(("action", "mode"), [("enable", Mode.READY), ("resume", Mode.HOLD)])
def test_nothing_moves_while_an_essential_sensor_is_stale(ann, action, mode):
    ann.see(mode=mode)
    ann.sense(stale=True)
    reply = ann.ask(t.MODE, action=action)
    assert (reply.ok, reply.reason) == (False, Why.SENSOR_STALE)
    assert "force_torque" in reply.detail
    assert not ann.services.modes.resume


# --- the protective stop --------------------------------------------------------------------------


def test_anybody_may_ask_for_the_protective_stop_and_it_stays(ann):
    assert ann.ask(t.PROTECTIVE_STOP, operator="bystander").ok
    assert ann.services.stops.asked_by == "bystander"
    ann.pass_time(60.0)
    assert ann.services.stops.asked_by == "bystander"


@pytest.mark.parametrize(("action", "mode"), [("enable", Mode.READY), ("resume", Mode.HOLD)])
def test_nothing_moves_while_the_protective_stop_is_latched(ann, action, mode):
    ann.ask(t.PROTECTIVE_STOP, operator="bystander", seal=SEAL)
    ann.see(mode=mode)
    reply = ann.ask(t.MODE, action=action)
    assert (reply.ok, reply.reason) == (False, Why.PROTECTIVE_STOP)
    assert "bystander" in reply.detail
    ann.ask(t.PROTECTIVE_CLEAR, operator="bystander", opens=OPENS)
    ann.ask(t.MODE, action=action)
    assert ann.services.modes.resume or ann.services.modes.action is PendingAction.ENABLE


def test_who_asked_may_clear_it_by_opening_its_seal(ann):
    ann.ask(t.PROTECTIVE_STOP, operator="bystander", seal=SEAL)
    assert ann.ask(t.PROTECTIVE_CLEAR, operator="bystander", opens=OPENS).ok
    assert ann.services.stops.asked_by is None


def test_the_lease_holder_may_clear_all_of_them_by_proof(ann):
    ann.ask(t.PROTECTIVE_STOP, operator="bystander", seal=SEAL)
    ann.ask(t.PROTECTIVE_STOP, operator="another")
    assert ann.ask_proving(t.PROTECTIVE_CLEAR, operator="ann").ok
    assert ann.services.stops.asked_by is None


@pytest.mark.parametrize("opens", [None, b"g" * 32, SEAL])
@pytest.mark.parametrize("operator", ["stranger", "bystander", "ann"])
def test_no_name_clears_it_and_no_guess_nor_what_was_heard(ann, operator, opens):
    ann.ask(t.PROTECTIVE_STOP, operator="bystander", seal=SEAL)
    reply = ann.ask(t.PROTECTIVE_CLEAR, operator=operator, opens=opens)
    assert (reply.ok, reply.reason) == (False, Why.NOT_YOURS)
    assert ann.services.stops.asked_by == "bystander"


def test_a_clear_that_was_heard_opens_no_later_stop(ann):
    ann.ask(t.PROTECTIVE_STOP, operator="bystander", seal=SEAL)
    ann.ask(t.PROTECTIVE_CLEAR, operator="bystander", opens=OPENS)
    ann.ask(t.PROTECTIVE_STOP, operator="bystander", seal=sha256(b"p" * 32).digest())
    assert not ann.ask(t.PROTECTIVE_CLEAR, operator="bystander", opens=OPENS).ok
    assert ann.services.stops.asked_by == "bystander"


def test_a_holders_clear_that_was_heard_clears_no_later_stop(ann):
    heard = encode(requests.ProtectiveClear(operator="ann"))
    key = t.PROTECTIVE_CLEAR.full_key(CELL)
    proof = prove(ann.secret, key, ann.admission.lease.epoch, 1, heard)
    ann.ask(t.PROTECTIVE_STOP, operator="bystander")
    assert ann.put(t.PROTECTIVE_CLEAR, heard, proof).ok
    ann.ask(t.PROTECTIVE_STOP, operator="bystander")
    assert not ann.put(t.PROTECTIVE_CLEAR, heard, proof).ok
    assert ann.services.stops.asked_by == "bystander"


def test_who_asks_for_a_stop_and_clears_it_clears_nobody_elses(ann):
    ann.ask(t.PROTECTIVE_STOP, operator="bystander", seal=SEAL)
    theirs = b"t" * 32
    ann.ask(t.PROTECTIVE_STOP, operator="attacker", seal=sha256(theirs).digest())
    reply = ann.ask(t.PROTECTIVE_CLEAR, operator="attacker", opens=theirs)
    assert reply.ok
    assert "bystander" in reply.detail
    assert ann.services.stops.asked_by == "bystander"


def test_a_flood_of_stops_is_remembered_in_little_and_lets_nobody_clear_another(ann):
    ann.ask(t.PROTECTIVE_STOP, operator="bystander", seal=SEAL)
    theirs = [n.to_bytes(32, "big") for n in range(200)]
    for opens in theirs:
        ann.ask(t.PROTECTIVE_STOP, operator="attacker", seal=sha256(opens).digest())
    for opens in theirs:
        ann.ask(t.PROTECTIVE_CLEAR, operator="attacker", opens=opens)
    assert ann.services.stops.asked_by is not None
    ann.ask(t.PROTECTIVE_CLEAR, operator="bystander", opens=OPENS)
    assert ann.services.stops.asked_by == "attacker"  # one beyond those that are kept apart
    assert ann.ask_proving(t.PROTECTIVE_CLEAR, operator="ann").ok
    assert ann.services.stops.asked_by is None


def test_the_proof_of_a_lease_that_ran_out_clears_nothing(ann):
    ann.ask(t.PROTECTIVE_STOP, operator="bystander")
    ann.see(now=Instant(ann.context.now.time_s + 5.0, 1500, None))
    assert not ann.ask_proving(t.PROTECTIVE_CLEAR, operator="ann").ok
    assert ann.services.stops.asked_by == "bystander"


# --- settings -------------------------------------------------------------------------------------


def test_gains_are_set_unless_they_would_be_unstable(ann):
    before = ann.commands.settings.gains["position"]
    reply = ann.ask(t.GAIN, source="position", gain=(60.0,) * 6)
    assert (reply.ok, reply.reason) == (False, Why.UNSTABLE_GAIN)
    assert reply.detail.startswith("gain[0] = 60: loop gain 0.6, stable below 0.445")
    assert ann.commands.settings.gains["position"] is before
    assert ann.ask(t.GAIN, source="position", gain=(3.0,) * 6).ok
    np.testing.assert_array_equal(ann.commands.settings.for_control().gains["position"], [3.0] * 6)


def test_a_source_is_switched_off_and_on(ann):
    assert ann.ask(t.SWITCH, source="joystick", on=False).ok
    assert not ann.commands.settings.for_control().gains["joystick"].any()
    assert ann.ask(t.SWITCH, source="joystick", on=True).ok
    assert ann.commands.settings.for_control().gains["joystick"].all()


@pytest.mark.parametrize(
    ("topic", "more"), [(t.GAIN, {"gain": (1.0,) * 6}), (t.SWITCH, {"on": True})]
)
def test_a_source_that_there_is_not_is_refused_with_those_that_there_are(ann, topic, more):
    reply = ann.ask(topic, source="gravity", **more)
    assert (reply.ok, reply.reason) == (False, Why.UNKNOWN_SOURCE)
    assert "'gravity' is none of joystick, position" in reply.detail
    assert "gravity" not in ann.commands.settings.for_control().gains


def test_an_objective_is_set_inside_the_bounds_that_the_cell_file_has(ann):
    assert ann.ask(t.REDUNDANCY, objective="least_energy", gain=0.7).ok
    assert ann.commands.settings.objectives.gains["least_energy"] == 0.7
    reply = ann.ask(t.REDUNDANCY, objective="least_energy", gain=2.0)
    assert (reply.ok, reply.reason) == (False, Why.OUT_OF_RANGE)
    assert "less than or equal to 1" in reply.detail
    assert ann.commands.settings.objectives.gains["least_energy"] == 0.7
    assert ann.ask(t.REDUNDANCY, objective="mid_range", gain=2.0).ok


def test_an_objective_that_there_is_not_is_refused_with_those_that_there_are(ann):
    reply = ann.ask(t.REDUNDANCY, objective="beauty", gain=0.5)
    assert (reply.ok, reply.reason) == (False, Why.UNKNOWN_OBJECTIVE)
    assert "mid_range, manipulability" in reply.detail


def test_position_switched_on_again_begins_its_path_from_where_the_arm_is(ann):
    envelope = {"seen_tick": 1}
    target = m.PositionTarget(**envelope, xyz=(0.1, 0, 0), rpy=(0, 0, 0))
    ann.commands.take(target, 0.0, ann.commands.frames.T_world_crf)
    attempt = ann.commands.goals.goal.attempt
    ann.ask(t.SWITCH, source="position", on=False)
    assert ann.commands.goals.goal.attempt == attempt
    ann.ask(t.SWITCH, source="position", on=True)
    assert ann.commands.goals.goal.attempt > attempt


def test_frame_and_speed_are_set(ann):
    assert ann.ask(t.FRAME, frame="mrf", xyz=(0.0, 0.0, 0.1), rpy=(0.0, 0.0, 0.0)).ok
    assert ann.ask(t.SPEED, factor=0.25).ok
    settings = ann.commands.settings.for_control()
    np.testing.assert_array_equal(settings.T_wrist_mrf.p, (0.0, 0.0, 0.1))
    assert settings.speed_factor == 0.25


def test_gains_that_would_be_unstable_can_be_forced_and_that_is_told(ann):
    assert ann.ask(t.PAYLOAD, mass=0.0).ok  # nothing that could swing at such a gain
    ann.events.take()
    reply = ann.ask(t.GAIN, source="force", gain=(6.0,) * 6, forced=True)
    assert reply.ok
    np.testing.assert_array_equal(ann.commands.settings.gains["force"], [6.0] * 6)
    assert "gain_forced" in names(ann)
    assert ann.ask(t.GAIN, source="force", gain=(7e-4,) * 3 + (0.03,) * 3, forced=True).ok
    assert "gain_forced" not in names(ann)


def test_a_payload_is_switched_by_mass_and_centre(ann):
    bias = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    assert ann.ask(t.PAYLOAD, mass=2.5, com=(0.0, 0.01, 0.1), bias=bias).ok
    settings = ann.commands.settings.for_control()
    assert settings.payload.mass == 2.5
    np.testing.assert_array_equal(settings.payload.com, (0.0, 0.01, 0.1))
    np.testing.assert_array_equal(settings.wrench_bias, -np.array(bias))
    assert names(ann)[-1] == "payload_set"
    assert ann.ask(t.PAYLOAD, mass=0.0).ok
    np.testing.assert_array_equal(ann.commands.settings.for_control().wrench_bias, -np.array(bias))


def test_a_payload_heavier_than_the_arm_is_rated_for_is_refused(ann):
    ann.lease()
    reply = ann.ask(t.PAYLOAD, mass=10.1)
    assert (reply.ok, reply.reason) == (False, Why.OUT_OF_RANGE)
    assert "rated for 10" in reply.detail


def test_an_operator_says_that_a_load_is_unknown_and_that_one_may_act(ann):
    ann.lease()
    before = ann.commands.settings.payload
    assert ann.ask(t.PAYLOAD, unknown=True).ok
    assert ann.commands.settings.payload is before
    assert ann.commands.settings.load_heard == "unknown"
    assert ann.ask(t.ACKNOWLEDGE_LOAD).ok
    assert ann.commands.settings.load_heard == "acknowledged"


def test_a_payload_that_the_cell_does_not_name_is_refused(ann):
    before = ann.commands.settings.for_control().payload
    reply = ann.ask(t.PAYLOAD, name="anvil")
    assert (reply.ok, reply.reason) == (False, Why.UNKNOWN_PAYLOAD)
    assert ann.commands.settings.for_control().payload is before


def test_a_tare_takes_the_unloaded_reading_for_no_contact(ann):
    assert ann.ask(t.TARE).ok
    np.testing.assert_array_equal(ann.commands.settings.for_control().wrench_bias, np.arange(6.0))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [({"still": False}, Why.NOT_NOW), ({"unloaded": None}, Why.SENSOR_STALE)],
)
def test_a_tare_is_refused_while_the_arm_moves_or_the_sensor_is_silent(ann, changes, reason):
    before = ann.commands.settings.for_control().wrench_bias
    ann.sense(**changes)
    reply = ann.ask(t.TARE)
    assert (reply.ok, reply.reason) == (False, reason)
    assert ann.commands.settings.for_control().wrench_bias is before
