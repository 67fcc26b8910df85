"""The rig's own topics, over a real Zenoh router on loopback."""

import socket
from collections.abc import Iterator

import pytest
import zenoh
from telerobot.drivers.network.sessions import router_config
from telerobot.drivers.rig.session import RigSession
from telerobot.protocols import codec, topics
from telerobot.protocols.messages.rig import RigFault, RigTruth

TRIES = 100_000
TRUTH = RigTruth(
    time_s=1.0,
    sync_count=3,
    q=(0.5,),
    dq=(0.0,),
    pose_mrf=(0.0,) * 6,
    contact_force=(0.0, 0.0, 0.0),
    clearance_m=None,
    drives=("fault",),
)
FAULT = RigFault(kind="silence", target="e1")


@pytest.fixture
def endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def session(endpoint: str) -> Iterator[RigSession]:
    """A session that is opened before its router is there."""
    made = RigSession("pa10", endpoint)
    yield made
    made.close()


def test_it_runs_without_a_router_and_finds_one_that_comes_later(
    session: RigSession, endpoint: str
) -> None:
    session.publish(TRUTH)
    assert list(session.faults()) == []
    assert not session.heard
    router = zenoh.open(router_config(endpoint))
    heard = router.declare_subscriber(
        topics.RIG_TRUTH.full_key("pa10"), zenoh.handlers.RingChannel(1)
    )
    key = topics.RIG_FAULT.full_key("pa10")
    truth, faults = None, []
    for _ in range(TRIES):
        session.publish(TRUTH)
        router.put(key, b"no message")
        router.put(key, codec.encode(FAULT))
        truth = truth or heard.try_recv()
        faults += session.faults()
        if truth is not None and faults and session.heard:  # which is told by a thread of its own
            break
    assert session.heard
    router.close()
    assert truth is not None
    assert codec.decode_as(RigTruth, truth.payload.to_bytes()) == TRUTH
    assert set(faults) == {FAULT}
