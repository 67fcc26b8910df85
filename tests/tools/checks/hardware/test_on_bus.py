"""`telerobot check CELL --bus` and `--profile`: the virtual hardware, and cells that deviate."""

import json

import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.bus import NodeIdentitySection
from telerobot.drivers.device import DeviceError
from telerobot.drivers.fieldbus import Fieldbuses
from telerobot.protocols.canopen import can301
from telerobot.protocols.canopen.cia402 import Controlword, Object
from telerobot.protocols.messages.rig import RigFault
from telerobot.tools.checks.findings import Severity, failed, to_json
from telerobot.tools.checks.hardware.on_bus import compared, listen_for_masters
from telerobot.tools.cli import main

from tests.drivers.rig.on_a_bus import OnABus

JOINT = "e1"


@pytest.fixture
def bench():
    made = OnABus(load_cell("pa10"))
    yield made
    made.close()


def deviating(joint=JOINT, **changes):
    """Return the shipped cell with one drive's table changed."""
    cell = load_cell("pa10")
    drives = [
        drive.model_copy(update=changes) if drive.joint == joint else drive
        for drive in cell.config.mechanism.drives
    ]
    return altered(cell, {"mechanism.drives": drives})


def findings(bench, cell):
    return {f.check: f for f in compared(cell, Fieldbuses(bench.fieldbus))}


def errors(found):
    return {check: f.text for check, f in found.items() if f.status is not Severity.OK}


def test_the_cells_own_hardware_is_as_the_cell_says_and_nothing_is_written(bench):
    found = findings(bench, load_cell("pa10"))
    assert errors(found) == {}
    assert found["bus"].text == "nodes that answer: 1, 2, 3, 4, 5, 6, 7"
    assert "simulated servo drive, vendor 0x0, product 0x402" in found["e1 identity"].text
    assert "holds no limits" in found["e1 607Dh"].text
    sent = {(can_id & 0x780, data[0] & 0xE0) for can_id, data in bench.sent}
    assert sent <= {(0x600, 0x40), (0x600, 0x60)}, "uploads only"
    assert json.loads(to_json({}, list(found.values())))["findings"]


def test_a_wrong_node_is_named_with_who_is_there_instead(bench):
    told = errors(findings(bench, deviating(node=19)))
    assert told["e1 node"] == "node 19 does not answer; not in the cell, but there: 4"
    assert told["node 4"].startswith("answers, and is not in the cell: simulated servo drive")
    assert set(told) == {"e1 node", "node 4"}


def test_a_wrong_identity_is_told_field_by_field(bench):
    told = errors(
        findings(bench, deviating(identity=NodeIdentitySection(vendor=5, product=0x402, serial=9)))
    )
    assert set(told) == {"e1 identity"}
    assert "vendor 0x0, the cell says 0x5" in told["e1 identity"]
    assert "serial 0x4, the cell says 0x9" in told["e1 identity"]
    assert "product 0x402, the cell" not in told["e1 identity"]


def _write(bench, index, subindex, value, size=4):
    node = bench.rig.drives[JOINT]
    node.objects.set_data(index, subindex, value.to_bytes(size, "little", signed=True))


def test_other_limits_in_the_drive_are_told_in_the_joints_unit(bench):
    drive = bench.drives[JOINT]
    _write(bench, Object.POSITION_LIMIT, 1, round(-0.5 * drive.counts_per_radian))
    _write(bench, Object.POSITION_LIMIT, 2, round(0.5 * drive.counts_per_radian))
    found = findings(bench, load_cell("pa10"))
    assert set(errors(found)) == {"e1 607Dh"}
    ends = [found["e1 607Dh"].values[end] for end in ("lower", "upper")]
    assert ends == pytest.approx([drive.zero_rad - 0.5, drive.zero_rad + 0.5], abs=1e-4)
    assert "which of them is right" in found["e1 607Dh"].text


def test_a_scale_that_is_wrong_shows_in_position_and_torque(bench):
    told = errors(findings(bench, deviating(counts_per_radian=2e5, rated_torque=0.5)))
    assert "is counts_per_radian, direction or zero_rad wrong?" in told["e1 position"]
    assert "behind a gear of" in told["e1 torque"]


def test_a_drive_in_fault_or_under_power_is_told(bench):
    bench.rig.inject(RigFault(kind="fault", target="s1"))
    for word in (Controlword.SHUTDOWN, Controlword.SWITCH_ON):
        _write(bench, Object.CONTROLWORD, 0, word, 2)
    told = errors(findings(bench, load_cell("pa10")))
    assert "2310h: overcurrent" in told["s1 state"]
    assert "its power is on" in told["e1 state"]


def test_beside_another_master_nothing_is_asked(bench):
    bench.bus.accept((can301.SYNC_ID, b"", 0.0))
    with pytest.raises(DeviceError, match="someone else sent 0x080"):
        listen_for_masters(bench.fieldbus)
    assert bench.sent == []


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (["--power"], 2, "--power is of use with --profile"),
        (["--profile", "e9"], 2, "no drive moves 'e9'; one of s1, s2, s3, e1"),
    ],
)
def test_a_choice_that_makes_no_sense_is_refused(arguments, code, told, capsys):
    assert main(["check", "pa10", *arguments]) == code
    assert told in capsys.readouterr().err


def test_a_bus_with_nobody_on_it_is_an_error(bench):
    for name in bench.rig.nodes:
        bench.rig.inject(RigFault(kind="silence", target=name))
    assert failed(list(findings(bench, load_cell("pa10")).values()))
