"""Every role, every key, every verb: tried at a real router, and held against this table."""

import json

import pytest
import zenoh
from telerobot.drivers.network.authority import write_router
from telerobot.drivers.network.sessions import client_config, dialling_config, router_config
from telerobot.protocols.topics import TOPICS

from .wire import Try, all_keys, free_endpoint, with_control

EVERY_KEY = {topic.key for topic in TOPICS}
COMMANDS = {key for key in EVERY_KEY if key.startswith("cmd/")}
REQUESTS = {key for key in EVERY_KEY if key.startswith("operator/")}
TELEMETRY = {
    f"tlm/{each}" for each in ("state", "event", "description", "reflection", "tick", "obstacle")
}
FAULTS = {"rig/fault", "rig/motion"}
TRUTH = {"rig/truth"}
SENSORS = {"sensor/vision", "sensor/obstacle", "sensor/contour", "sensor/frame"}
NAMED = {f"sensor/obstacle/{name}" for name in ("lidar", "judge-pa10", "vision")}
PICTURE, SCAN = {"view/picture", "view/video/wrist"}, {"view/scan"}
SHOWN = TELEMETRY | TRUTH | SENSORS | NAMED | PICTURE | SCAN

MAY = {
    "operator-ann": {"put": COMMANDS, "ask": REQUESTS, "hear": SHOWN},
    "observer-bob": {"hear": SHOWN},
    "sensor-vision": {"put": {"sensor/vision"} | PICTURE, "hear": TELEMETRY | TRUTH},
    "sensor-lidar": {
        "put": {"sensor/obstacle", "sensor/obstacle/lidar", "sensor/frame"},
        "hear": TELEMETRY | TRUTH,
    },
    "rig-pa10": {"put": TRUTH | {"sensor/frame"}, "hear": TELEMETRY | FAULTS | TRUTH},
    "judge-pa10": {
        "put": COMMANDS | FAULTS | SENSORS | {"sensor/obstacle/judge-pa10"} | PICTURE | SCAN,
        "ask": REQUESTS,
        "hear": SHOWN,
    },
    "operator-lost": {},
    "daemon-ur5e": {},
    "daemon-pa10": {},
    "router-hub": {},
}
"""What each certificate may do at the daemon of the cell pa10."""

AT_THE_ROUTER = {
    **MAY,
    "operator-lost": MAY["operator-ann"],
    "daemon-ur5e": {},
    "daemon-pa10": {"put": TELEMETRY, "hear": COMMANDS | SENSORS | NAMED, "serve": REQUESTS},
}
VERBS = ("put", "delete", "hear", "ask", "serve", "alive", "see alive")
KEYS = all_keys("pa10")
MODES = {"client": client_config, "peer": dialling_config, "router": dialling_config}


def table(may, cell="pa10"):
    """Return a row of `MAY` for every verb, with full keys."""
    return {verb: {f"telerobot/{cell}/{key}" for key in may.get(verb, ())} for verb in VERBS}


def dials(zone, mode, endpoint, name, cell="pa10"):
    """Return a session in a mode, which trusts every server: it is not held back by itself."""
    config = MODES[mode](endpoint, cell, zone.identity(name))
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("access_control", json.dumps({"enabled": False}))
    return zone.open(config)


def daemon(zone, endpoint, **how):
    (zone.folder / "operator-lost.crt").rename(zone.folder / "operator-lost.crt.away")
    config = router_config(endpoint, "pa10", zone.identity("daemon-pa10"))
    (zone.folder / "operator-lost.crt.away").rename(zone.folder / "operator-lost.crt")
    return zone.open(with_control(config, **how))


def common_router(zone, endpoint, monkeypatch):
    """Return a session with the configuration that is written for a router, from its folder."""
    (written,) = write_router(zone.folder, endpoint, "hub")
    monkeypatch.chdir(zone.folder)
    return zone.open(with_control(zenoh.Config.from_file(written.name)))


@pytest.fixture
def endpoint():
    return free_endpoint()


@pytest.mark.parametrize("name", MAY)
def test_a_certificate_may_do_at_the_daemon_what_its_role_says_and_nothing_else(
    zone, endpoint, name
):
    router = daemon(zone, endpoint)
    tried = Try(router, dials(zone, "client", endpoint, name), KEYS)
    assert tried.let_through() == table(MAY[name])


@pytest.mark.parametrize("name", ["operator-ann", "observer-bob", "sensor-vision", "operator-lost"])
def test_what_is_refused_is_refused_on_the_way_in_whatever_the_sender_was_told(
    zone, endpoint, name
):
    router = daemon(zone, endpoint, out=False)
    tried = Try(router, dials(zone, "client", endpoint, name), KEYS)
    assert tried.let_through() == table(MAY[name])


@pytest.mark.parametrize("mode", ["peer", "router"])
@pytest.mark.parametrize("name", ["operator-ann", "observer-bob", "operator-lost"])
def test_a_certificate_may_do_no_more_in_another_of_zenohs_modes(zone, endpoint, name, mode):
    router = daemon(zone, endpoint)
    tried = Try(router, dials(zone, mode, endpoint, name), KEYS)
    assert tried.let_through() == table(MAY[name])


@pytest.mark.parametrize("name", AT_THE_ROUTER)
def test_the_roles_are_the_same_at_a_common_router(zone, endpoint, name, monkeypatch):
    router = common_router(zone, endpoint, monkeypatch)
    keys = all_keys("pa10", "ur5e")
    through = Try(router, dials(zone, "client", endpoint, name), keys).let_through()
    there = table(AT_THE_ROUTER[name])
    if name == "daemon-ur5e":
        there = table(AT_THE_ROUTER["daemon-pa10"], "ur5e")
    assert through == there


def test_an_operator_of_two_cells_may_command_both(zone, endpoint, monkeypatch):
    router = common_router(zone, endpoint, monkeypatch)
    session = dials(zone, "client", endpoint, "operator-both")
    tried = Try(router, session, all_keys("pa10", "ur5e"))
    assert tried.passes(session, router, session.put) == {
        f"telerobot/{cell}/{key}" for cell in ("pa10", "ur5e") for key in COMMANDS
    }


def test_the_table_has_every_key_that_there_is():
    seen = {"view/picture", "view/video"} | SCAN
    assert COMMANDS | REQUESTS | TELEMETRY | FAULTS | TRUTH | SENSORS | seen == EVERY_KEY


def test_these_observations_see_everything_where_nothing_is_refused(zone, endpoint):
    config = router_config(endpoint, "pa10", zone.identity("daemon-pa10"))
    config.insert_json5("access_control", json.dumps({"enabled": False}))
    tried = Try(zone.open(config), dials(zone, "client", endpoint, "operator-ann"), KEYS)
    assert tried.let_through() == {verb: set(KEYS) for verb in VERBS}


@pytest.mark.parametrize("name", ["operator-ann", "operator-lost", "judge-pa10"])
@pytest.mark.parametrize("wild", ["telerobot/**", "**", "telerobot/*/cmd/*", "telerobot/pa10/**"])
def test_a_wildcard_opens_nothing(zone, endpoint, name, wild):
    router = daemon(zone, endpoint, out=False)
    session = dials(zone, "client", endpoint, name)
    tried = Try(router, session, KEYS)
    assert tried.passes(session, router, session.put, sent=[wild]) == set()
    assert tried.passes(router, session, router.put, subscribed=[wild]) == set()
    assert tried.reaches(session, router, asked=[wild]) == set()


@pytest.mark.parametrize("name", ["operator-ann", "daemon-pa10"])
def test_the_admin_space_is_closed(zone, endpoint, name):
    router = daemon(zone, endpoint)
    session = dials(zone, "client", endpoint, name)
    tried = Try(router, session, KEYS)
    for space in ("@/**", f"@/{router.zid()}/router", "@/*/router/config/**"):
        told = {str(reply.ok.key_expr) for reply in session.get(space)}
        assert all(key.startswith(f"@/{session.zid()}/") for key in told), "only of itself"
        assert tried.passes(session, router, session.put, sent=[space]) == set()


def test_the_admin_space_is_closed_without_certificates_too(zone):
    endpoint = free_endpoint("tcp")
    router = zone.open(router_config(endpoint))
    session = zone.open(client_config(endpoint))
    tried = Try(router, session, KEYS)
    assert tried.passes(session, router, session.put) == set(KEYS)
    told = {str(reply.ok.key_expr) for reply in session.get("@/**")}
    assert all(key.startswith(f"@/{session.zid()}/") for key in told), "only of itself"


def test_without_certificates_nobody_takes_the_daemons_part(zone):
    """A stranger may put, ask and listen, but not be the daemon, nor hear commands."""
    endpoint = free_endpoint("tcp")
    router = zone.open(router_config(endpoint, "pa10"))
    stranger = zone.open(client_config(endpoint))
    through = Try(router, stranger, KEYS).let_through()
    own = {f"telerobot/pa10/{key}" for key in TELEMETRY}
    told = {f"telerobot/pa10/{key}" for key in COMMANDS}
    asked = {f"telerobot/pa10/{key}" for key in REQUESTS}
    every = set(KEYS)
    assert through["put"] == through["delete"] == every - own
    assert through["hear"] == every - told
    assert through["ask"] == every
    assert through["serve"] == every - asked


def test_without_certificates_a_wildcard_hears_no_command_and_answers_no_request(zone):
    endpoint = free_endpoint("tcp")
    router = zone.open(router_config(endpoint, "pa10"))
    ann, stranger = zone.open(client_config(endpoint)), zone.open(client_config(endpoint))
    tried = Try(router, stranger, KEYS)
    told = {f"telerobot/pa10/{key}" for key in COMMANDS}
    asked = {f"telerobot/pa10/{key}" for key in REQUESTS}
    heard = tried.passes(ann, stranger, ann.put, KEYS, ("telerobot/**",))
    assert heard.isdisjoint(told)
    tried = Try(router, stranger, ("telerobot/**",))
    assert tried.reaches(ann, stranger, KEYS).isdisjoint(asked)
