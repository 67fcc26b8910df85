"""`telerobot certify`: what it makes, keeps, refuses and renews."""

import json
import stat
from datetime import UTC, datetime, timedelta

import pytest
from telerobot.config.load import ConfigError, load_cell
from telerobot.drivers.network.certificates import certificate, known, read
from telerobot.drivers.network.identity import identity_of
from telerobot.protocols.topics import Role
from telerobot.server.operators.link import doubts
from telerobot.tools.checks.findings import Severity
from telerobot.tools.checks.judge import judge
from telerobot.tools.cli import main
from telerobot.tools.host.address import moved

ARM = """
extends = "pa10"
[zenoh]
listen = "tls/0.0.0.0:7447"
[zenoh.security]
directory = "keys"
"""


@pytest.fixture
def arm(tmp_path):
    """Return the file of a cell with a folder for certificates, which is not there yet."""
    path = tmp_path / "arm.toml"
    path.write_text(ARM)
    return path


def certify(*arguments):
    return main(["certify", *map(str, arguments)])


def names(folder, suffix="crt"):
    return sorted(path.stem for path in folder.glob(f"*.{suffix}"))


def granted(folder, name):
    return {grant.uri for grant in certificate(read(folder / f"{name}.crt")).grants}


def days_left(folder, name):
    return (certificate(read(folder / f"{name}.crt")).ends - datetime.now(UTC)).days


def test_it_makes_an_authority_and_one_certificate_for_each_role_of_the_cell(arm, capsys):
    assert certify(arm) == 0
    keys = arm.parent / "keys"
    everybody = [
        "authority", "daemon-pa10", "judge-pa10", "observer-observer", "operator-operator",
        "rig-pa10",
    ]  # fmt: skip
    assert names(keys) == names(keys, "key") == everybody
    assert granted(keys, "operator-operator") == {"telerobot:pa10/operator"}
    assert granted(keys, "daemon-pa10") == {"telerobot:pa10/daemon"}
    assert "keep its key where nobody else gets at it" in capsys.readouterr().out


def test_private_keys_are_their_owners_alone(arm):
    certify(arm)
    keys = arm.parent / "keys"
    assert stat.S_IMODE(keys.stat().st_mode) == 0o700
    assert {stat.S_IMODE(key.stat().st_mode) for key in keys.glob("*.key")} == {0o600}


def test_one_more_operator_comes_later_from_the_same_authority(arm):
    certify(arm)
    keys = arm.parent / "keys"
    before = {path: path.read_bytes() for path in keys.iterdir()}
    assert certify(arm, "--operator", "ann") == 0
    assert {path: path.read_bytes() for path in before} == before
    assert "operator-ann" in names(keys)
    assert [one.name for one in known(keys)[0] if "ann" in one.name] == ["operator-ann"]


def test_an_authority_without_its_key_signs_nothing_and_is_not_replaced(arm, capsys):
    certify(arm)
    keys = arm.parent / "keys"
    (keys / "authority.key").rename(arm.parent / "away")
    before = {path: path.read_bytes() for path in keys.iterdir()}
    assert certify(arm, "--operator", "ann") == 2
    assert "authority.key: missing" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in keys.iterdir()} == before


def test_a_key_without_its_certificate_is_not_replaced(arm, capsys):
    certify(arm)
    lost = arm.parent / "keys" / "operator-operator.crt"
    lost.unlink()
    assert certify(arm) == 2
    assert "operator-operator.key: is there already" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["Ann", "../ann", "ann-b", "", "1st", "a" * 33, "ann,CN=x", "ä"])
def test_a_name_that_is_no_part_of_a_key_is_refused(arm, name, capsys):
    with pytest.raises(SystemExit) as caught:
        certify(arm, f"--operator={name}")
    assert caught.value.code == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (arm.parent / "keys").exists()


def test_a_sensor_is_certified_for_the_keys_that_are_named(arm):
    certify(arm, "--sensor", "vision", "--sensor", "lidar=obstacle,frame")
    keys = arm.parent / "keys"
    assert granted(keys, "sensor-vision") == {"telerobot:pa10/sensor/vision"}
    assert granted(keys, "sensor-lidar") == {
        "telerobot:pa10/sensor/obstacle",
        "telerobot:pa10/sensor/frame",
    }


def test_a_sensor_for_a_key_that_is_none_is_refused(arm, capsys):
    with pytest.raises(SystemExit):
        certify(arm, "--sensor", "lidar=cmd")
    assert "'cmd' is no sensor's key" in capsys.readouterr().err


def test_certificates_end_and_the_authority_later(arm):
    certify(arm)
    keys = arm.parent / "keys"
    assert days_left(keys, "operator-operator") == 729
    assert days_left(keys, "authority") == 3649
    certify(arm, "--operator", "guest", "--days", "3")
    assert days_left(keys, "operator-guest") == 2


def test_renewing_signs_anew_and_leaves_the_private_keys(arm):
    certify(arm, "--operator", "ann", "--days", "3")
    keys = arm.parent / "keys"
    (keys / "operator-ann.key").rename(arm.parent / "on-anns-machine.key")
    before = {path: path.read_bytes() for path in keys.glob("*.key")}
    assert certify(arm, "--renew", "--days", "400") == 0
    assert {path: path.read_bytes() for path in keys.glob("*.key")} == before
    assert days_left(keys, "operator-ann") == days_left(keys, "daemon-pa10") == 399
    (arm.parent / "on-anns-machine.key").rename(keys / "operator-ann.key")
    assert identity_of(load_cell(arm), Role.OPERATOR, "ann").certificate.name == "operator-ann"


def test_what_is_missing_in_a_certificate_is_added_only_when_told(arm, tmp_path, capsys):
    certify(arm, "--operator", "ann")
    other = tmp_path / "other.toml"
    other.write_text(ARM.replace('"pa10"', '"ur5e"'))
    assert certify(arm, other, "--operator", "ann") == 2
    assert "does not certify telerobot:ur5e/operator; --renew adds that" in capsys.readouterr().err
    assert certify(arm, other, "--operator", "ann", "--renew") == 0
    keys = arm.parent / "keys"
    assert granted(keys, "operator-ann") == {"telerobot:pa10/operator", "telerobot:ur5e/operator"}


def test_a_daemon_that_gets_another_name_is_certified_for_it_when_told(arm, capsys):
    certify(arm)
    assert certify(arm, "--host", "arm.local") == 2
    assert "does not certify arm.local; --renew adds that" in capsys.readouterr().err
    assert certify(arm, "--host", "arm.local", "--renew") == 0
    keys = arm.parent / "keys"
    assert {"arm.local", "127.0.0.1"} < certificate(read(keys / "daemon-pa10.crt")).hosts
    assert certificate(read(keys / "operator-operator.crt")).hosts == frozenset()


@pytest.mark.parametrize("host", ["arm local", "*.local", "-arm", "arm..local", ""])
def test_what_is_no_host_is_refused(arm, host, capsys):
    with pytest.raises(SystemExit):
        certify(arm, f"--host={host}")
    assert "is no host's name or address" in capsys.readouterr().err


def test_an_endpoint_without_its_router_is_refused(arm, capsys):
    assert certify(arm, "--listen", "tls/[::]:7447") == 2
    assert "name it by --router" in capsys.readouterr().err
    assert not (arm.parent / "keys").exists()


def test_a_certificate_of_another_authority_is_not_renewed(arm, tmp_path, capsys):
    certify(arm, "--operator", "ann")
    certify(arm, "--directory", tmp_path / "foreign", "--operator", "eve")
    foreign = tmp_path / "foreign" / "operator-eve.crt"
    (arm.parent / "keys" / foreign.name).write_bytes(foreign.read_bytes())
    assert certify(arm, "--renew") == 2
    assert "operator-eve.crt: not issued by" in capsys.readouterr().err


def test_a_routers_file_is_written_again_when_somebody_comes(arm):
    certify(arm, "--router", "hub", "--host", "hub.local", "--listen", "tls/0.0.0.0:7500")
    keys = arm.parent / "keys"
    certify(arm, "--operator", "ann")
    file = json.loads((keys / "router-hub.json5").read_text())
    assert file["listen"]["endpoints"] == ["tls/0.0.0.0:7500"]
    assert file["access_control"]["default_permission"] == "deny"
    subjects = {subject["id"] for subject in file["access_control"]["subjects"]}
    assert {"daemon-pa10", "operator-ann", "rig-pa10"} < subjects
    assert "hub.local" in certificate(read(keys / "router-hub.crt")).hosts
    assert "hub.local" not in certificate(read(keys / "daemon-pa10.crt")).hosts


def test_a_cell_that_names_no_folder_needs_one(capsys):
    assert certify("pa10") == 2
    assert "zenoh.security.directory: missing; or say --directory" in capsys.readouterr().err


# --- what a process finds there ------------------------------------------------------------------


def refusal(path, role, name, topic="", **change):
    with pytest.raises(ConfigError) as caught:
        identity_of(moved(load_cell(path), **change), role, name, topic)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_each_process_finds_its_own(arm):
    certify(arm, "--operator", "ann", "--sensor", "vision")
    cell = load_cell(arm)

    def found(*who):
        return identity_of(cell, *who).certificate.name

    assert found(Role.DAEMON, "pa10") == "daemon-pa10"
    assert found(Role.OPERATOR, "ann") == "operator-ann"
    assert found(Role.OPERATOR, "anybody") == "operator-ann", "the only one here"
    assert found(Role.SENSOR, "vision", "sensor/vision") == "sensor-vision"
    assert identity_of(load_cell("pa10"), Role.OPERATOR, "ann") is None


@pytest.mark.parametrize("asked", [[], ["--sensor", "scan", "--sensor", "vision"]])
def test_the_scanners_process_finds_one_for_contour_and_boxes(arm, asked):
    arm.write_text(ARM.replace('"pa10"', '"rover_bridge"'))
    certify(arm, *asked)
    both = {f"telerobot:rover_bridge/sensor/{key}" for key in ("contour", "obstacle")}
    assert granted(arm.parent / "keys", "sensor-scan") == both
    for key in ("sensor/contour", "sensor/obstacle"):
        found = identity_of(load_cell(arm), Role.SENSOR, "scan", key)
        assert found.certificate.name == "sensor-scan"


def test_a_scanner_that_may_not_tell_of_boxes_is_refused_before_it_scans(arm, capsys):
    arm.write_text(ARM.replace('"pa10"', '"rover_bridge"'))
    certify(arm, "--sensor", "scan=contour")
    assert main(["scan", str(arm)]) == 2
    told = capsys.readouterr().err
    assert "sensor-scan.crt: does not certify telerobot:rover_bridge/sensor/obstacle" in told


def test_of_several_operators_the_one_of_the_name_is_taken_or_none(arm):
    certify(arm, "--operator", "ann", "--operator", "bob")
    assert identity_of(load_cell(arm), Role.OPERATOR, "bob").certificate.name == "operator-bob"
    assert "operator-eve.crt: not there" in refusal(arm, Role.OPERATOR, "eve")


def test_a_folder_that_is_not_there_is_said(arm):
    told = refusal(arm, Role.OPERATOR, "ann")
    assert told.startswith(f"{arm.parent / 'keys'}: not there: telerobot certify makes it")
    certify(arm)
    (arm.parent / "keys" / "authority.crt").unlink()
    assert "authority.crt: cannot be read: No such file" in refusal(arm, Role.OPERATOR, "ann")


def test_a_certificate_may_be_named_with_its_ending(arm):
    certify(arm, "--operator", "ann", "--operator", "bob")
    cell = moved(load_cell(arm), identity=arm.parent / "keys" / "operator-bob.crt")
    assert identity_of(cell, Role.OPERATOR, "ann").certificate.name == "operator-bob"


def test_the_wrong_certificate_is_said(arm, tmp_path):
    certify(arm, "--operator", "ann", "--sensor", "vision", "--observer", "bob")
    keys = arm.parent / "keys"
    assert "does not certify telerobot:pa10/daemon" in refusal(
        arm, Role.DAEMON, "pa10", identity=keys / "observer-bob"
    )
    assert "does not certify telerobot:pa10/sensor/obstacle" in refusal(
        arm, Role.SENSOR, "vision", "sensor/obstacle"
    )
    other = tmp_path / "other.toml"
    other.write_text(ARM.replace('"pa10"', '"ur5e"'))
    assert "does not certify telerobot:ur5e/operator" in refusal(other, Role.OPERATOR, "ann")
    (keys / "observer-bob.crt").rename(keys / "operator-mallory.crt")
    (keys / "observer-bob.key").rename(keys / "operator-mallory.key")
    assert "is the certificate of observer-bob" in refusal(arm, Role.OPERATOR, "mallory")


def test_a_key_of_somebody_else_is_said(arm):
    certify(arm, "--operator", "ann", "--operator", "bob")
    keys = arm.parent / "keys"
    (keys / "operator-ann.key").write_bytes((keys / "operator-bob.key").read_bytes())
    assert "is not the key of operator-ann.crt" in refusal(arm, Role.OPERATOR, "ann")


@pytest.mark.parametrize(
    ("endpoint", "words"),
    [
        ("tcp/127.0.0.1:7447", "with certificates the endpoint begins with tls/"),
        ("tls/127.0.0.1:7447#verify_name_on_connect=false", "takes no options of its own"),
    ],
)
def test_an_endpoint_that_would_do_without_is_refused(arm, endpoint, words):
    certify(arm)
    assert words in refusal(arm, Role.OPERATOR, "operator", endpoint=endpoint)


def test_an_endpoint_that_wants_certificates_gets_some():
    told = refusal("pa10", Role.OPERATOR, "ann", endpoint="tls/127.0.0.1:7447")
    assert "needs certificates: zenoh.security.directory, --identity" in told


def test_behind_a_router_its_certificate_is_needed(arm):
    certify(arm)
    routed = arm.with_name("routed.toml")
    routed.write_text(ARM.replace("listen", "router"))
    assert "no router-NAME.crt there" in refusal(routed, Role.DAEMON, "pa10")


# --- before it is too late -----------------------------------------------------------------------


def warnings(path):
    return [f.text for f in judge(load_cell(path)) if f.status is Severity.WARN]


def test_check_warns_of_certificates_that_end_soon(arm):
    certify(arm)
    assert warnings(arm) == []
    certify(arm, "--operator", "guest", "--days", "20")
    day = datetime.now(UTC) + timedelta(days=20)
    assert warnings(arm) == [f"operator-guest: expires on {day:%Y-%m-%d}, in 19 days"]


def test_the_daemon_says_the_same_when_it_starts(arm, tmp_path):
    certify(arm)
    cell = load_cell(arm)

    def daemons():
        return doubts(identity_of(cell, Role.DAEMON, "pa10"))

    assert daemons() == []
    certify(arm, "--operator", "guest", "--days", "1")
    assert [words.partition(" on ")[0] for words in daemons()] == ["operator-guest: expires"]
    certify(arm, "--directory", tmp_path / "foreign", "--operator", "eve")
    foreign = tmp_path / "foreign" / "operator-eve.crt"
    (arm.parent / "keys" / foreign.name).write_bytes(foreign.read_bytes())
    assert "operator-eve.crt: not issued by the authority.crt" in daemons()[0]
    assert "operator-eve" not in [one.name for one in known(arm.parent / "keys")[0]]


def test_doctor_looks_at_a_cells_certificates_too(arm, capsys):
    certify(arm)
    capsys.readouterr()
    main(["doctor", str(arm), "--seconds=0.01", "--json"])
    report = json.loads(capsys.readouterr().out)
    (found,) = (f for f in report["findings"] if f["check"] == "certificates")
    assert found["status"] == "ok"
    assert found["values"]["days"] == 729


def test_check_warns_of_keys_that_others_may_read(arm):
    certify(arm)
    (arm.parent / "keys" / "rig-pa10.key").chmod(0o644)
    assert ["others may read it (mode 644)" in text for text in warnings(arm)] == [True]


def test_check_says_what_is_not_there(arm):
    assert ["telerobot certify makes certificates" in text for text in warnings(arm)] == [True]


def test_check_refuses_a_daemon_that_anybody_may_command(arm):
    arm.write_text(ARM.replace("tls/", "tcp/").replace('directory = "keys"', ""))
    assert main(["check", str(arm)]) == 1
    arm.write_text(ARM.replace("tls/", "tcp/").replace('directory = "keys"', "insecure = true"))
    assert [text.partition(": ")[2] for text in warnings(arm)] == [
        "insecure: anybody who reaches it may command"
    ]


def test_the_name_of_a_folder_does_nothing_to_the_terminal(arm, capsys):
    folder = arm.parent / "\x1b]0;mine\x07\u202e"
    assert certify(arm, "--directory", folder) == 0
    lines = capsys.readouterr().out.splitlines()
    assert all(line.isprintable() for line in lines)
    assert any(r"\u001b]0;mine\u0007\u202e" in line for line in lines)
