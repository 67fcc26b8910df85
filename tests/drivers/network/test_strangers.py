"""Who has no certificate, or a wrong one, gets no link; who has one believes no other server."""

from datetime import UTC, datetime, timedelta

import pytest
import zenoh
from telerobot.drivers.network.sessions import client_config, router_config

from .conftest import Zone
from .wire import free_endpoint

STATE = "telerobot/pa10/tlm/state"
STICK = "telerobot/pa10/cmd/joystick"


@pytest.fixture
def endpoint():
    return free_endpoint()


@pytest.fixture
def daemon(zone, endpoint):
    """Return the session of a daemon that listens, and answers on the lease's key."""
    session = zone.open(router_config(endpoint, "pa10", zone.identity("daemon-pa10")))
    session.declare_queryable(
        "telerobot/pa10/operator/lease", lambda query: query.reply(query.key_expr, b"granted")
    )
    return session


def serves(zone, endpoint, name):
    """Return whether a certificate's holder is answered by the daemon."""
    session = zone.open(client_config(endpoint, "pa10", zone.identity(name)))
    # A session that is just open does not know yet who answers.
    return any(list(session.get("telerobot/pa10/operator/lease")) for _ in range(50))


def refused(config):
    with pytest.raises(zenoh.ZError, match="Unable to connect"):
        zenoh.open(config)


def test_an_operator_is_served(zone, daemon, endpoint):
    assert serves(zone, endpoint, "operator-ann")


def test_plain_tcp_is_refused(daemon, endpoint):
    refused(client_config(endpoint.replace("tls/", "tcp/")))


def test_a_client_without_a_certificate_is_refused(zone, daemon, endpoint):
    config = client_config(endpoint)
    ca = str(zone.folder / "authority.crt")
    config.insert_json5("transport/link/tls", f'{{"root_ca_certificate": "{ca}"}}')
    refused(config)


def test_a_certificate_of_another_authority_is_refused(zone, daemon, endpoint, tmp_path):
    other = Zone(tmp_path / "other", {"operator-ann": ("pa10/operator",)})
    (other.folder / "authority.crt").write_bytes((zone.folder / "authority.crt").read_bytes())
    refused(client_config(endpoint, "pa10", other.identity("operator-ann")))
    assert serves(zone, endpoint, "operator-ann")


@pytest.mark.parametrize("when", ["expired", "not yet"])
def test_a_certificate_out_of_its_time_is_refused(zone, daemon, endpoint, when):
    far = timedelta(days=10)
    now = datetime.now(UTC) + (far if when == "not yet" else -far)
    zone.certify("operator-late", "pa10/operator", now=now, days=5)
    refused(client_config(endpoint, "pa10", zone.identity("operator-late")))


def test_a_link_ends_with_the_certificate_that_opened_it(zone, endpoint):
    short = datetime.now(UTC) - timedelta(days=1) + timedelta(seconds=4)
    zone.certify("operator-short", "pa10/operator", now=short, days=1)
    ends = zone.identity("operator-short").certificate.ends
    router = zone.open(router_config(endpoint, "pa10", zone.identity("daemon-pa10")))
    session = zone.open(client_config(endpoint, "pa10", zone.identity("operator-short")))
    assert list(session.info.routers_zid()) == [router.zid()]
    while list(session.info.routers_zid()):
        assert datetime.now(UTC) < ends + timedelta(seconds=20), "the link stays"


@pytest.mark.parametrize("name", ["operator-ann", "sensor-vision", "rig-pa10", "observer-bob"])
def test_nobody_but_servers_can_serve(zone, endpoint, name):
    zone.open(router_config(endpoint, "pa10", zone.identity(name)))
    refused(client_config(endpoint, "pa10", zone.identity("operator-both")))


def test_a_server_is_believed_only_under_the_names_it_is_certified_for(zone, endpoint):
    zone.certify("daemon-far", "pa10/daemon", hosts=("far.example",))
    zone.open(router_config(endpoint, "pa10", zone.identity("daemon-far")))
    refused(client_config(endpoint, "pa10", zone.identity("operator-ann")))


def test_another_cells_daemon_in_the_same_place_hears_nothing(zone, endpoint):
    """As would a server with a certificate for this host from a public authority."""
    config = router_config(endpoint, "pa10", zone.identity("daemon-ur5e"))
    other = zone.open(config)
    heard = other.declare_subscriber(STICK, zenoh.handlers.RingChannel(8))
    other.declare_queryable("**", lambda query: query.reply(query.key_expr, b"granted"))
    session = zone.open(client_config(endpoint, "pa10", zone.identity("operator-ann")))
    states = session.declare_subscriber(STATE, zenoh.handlers.RingChannel(8))
    believes = zone.open(client_config(endpoint, "ur5e", zone.identity("operator-ann")))
    control = believes.declare_subscriber(STATE, zenoh.handlers.RingChannel(8))
    while control.try_recv() is None:
        session.put(STICK, b"x")
        other.put(STATE, b"x")
    assert list(session.get("telerobot/pa10/operator/lease")) == []
    assert states.try_recv() is None
    assert heard.try_recv() is None


def test_the_identifier_of_an_operators_session_opens_nothing(zone, endpoint):
    router = zone.open(router_config(endpoint, "pa10", zone.identity("daemon-pa10")))
    heard = router.declare_subscriber(STICK, zenoh.handlers.RingChannel(8))
    ann = zone.open(client_config(endpoint, "pa10", zone.identity("operator-ann")))
    while heard.try_recv() is None:
        ann.put(STICK, b"ann")
    config = client_config(endpoint, "pa10", zone.identity("observer-bob"))
    config.insert_json5("id", f'"{ann.zid()}"')
    refused(config)
    ann.put(STICK, b"still ann")
    while (payload := heard.recv().payload.to_bytes()) != b"still ann":
        assert payload == b"ann"
