"""The rules of CiA 301 and CiA 402-2, each with its clause, on the simulated drive."""

from collections.abc import Callable, Iterator

import pytest
from telerobot.config.load import load_cell
from telerobot.drivers.device import DeviceError
from telerobot.drivers.rig.nodes.canopen import CanNode
from telerobot.protocols.canopen import can301
from telerobot.protocols.canopen.cia402 import Controlword, DriveState, Object
from telerobot.tools.checks.findings import Severity
from telerobot.tools.checks.hardware.trial import Rule, TriedDrive, rules, try_drive

from ..rig.on_a_bus import OnABus

JOINT = "e1"


@pytest.fixture(scope="module")
def bench() -> Iterator[OnABus]:
    made = OnABus(load_cell("pa10"))
    yield made
    made.close()


@pytest.fixture
def subject(bench: OnABus) -> Iterator[TriedDrive]:
    made = TriedDrive(bench.fieldbus, bench.node(JOINT))
    made.restart()
    yield made
    made.put_back()


@pytest.mark.parametrize("rule", rules(power=True), ids=lambda r: f"{r.clause}: {r.promise}")
def test_the_simulated_drive_keeps(rule: Rule, subject: TriedDrive) -> None:
    rule.judge(subject)


def test_without_leave_no_drive_is_powered_and_afterwards_it_is_as_before(bench: OnABus) -> None:
    states: set[DriveState] = set()
    drive = bench.rig.drives[JOINT]
    before = {index: drive.objects[index, 0] for index in (0x6060, 0x605A, 0x6085, 0x6065, 0x6066)}
    posture, step = bench.rig.world.q.copy(), bench.rig.step

    def watched() -> None:
        step()
        states.add(drive.state)

    bench.rig.step = watched  # type: ignore[method-assign]  # looks on
    try:
        found = list(try_drive(bench.fieldbus, bench.node(JOINT), power=False))
    finally:
        bench.rig.step = step  # type: ignore[method-assign]
    assert [f.text for f in found if f.status is not Severity.OK] == []
    assert states <= {DriveState.SWITCH_ON_DISABLED, DriveState.READY_TO_SWITCH_ON}
    assert {index: drive.objects[index, 0] for index in before} == before
    assert bench.rig.world.q == pytest.approx(posture, abs=1e-5)


def test_a_drive_that_breaks_a_rule_is_told_with_its_clause(
    bench: OnABus, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that takes any mode, and sends nothing on change, as this one once did."""
    monkeypatch.setattr(bench.rig.drives[JOINT].objects, "choices", {})
    monkeypatch.setattr(CanNode, "_tell", lambda *_: None)
    found = list(try_drive(bench.fieldbus, bench.node(JOINT), power=False))
    broken = {f.check: f.text for f in found if f.status is Severity.ERROR}
    assert set(broken) == {"CiA 301, 7.5.2.37", "CiA 402-2, 6060h", "CiA 402-2, 605Ah"}
    assert broken["CiA 402-2, 6060h"].endswith(": 6060h:0 takes 99")


def _switch_on(bench: OnABus) -> None:
    node = bench.node("s1")
    subject = TriedDrive(bench.fieldbus, node)
    subject.put(Object.MODE_OF_OPERATION, 0, "<b", 8)
    subject.command(Controlword.SHUTDOWN)
    subject.command(Controlword.SWITCH_ON)


def _another_master(bench: OnABus) -> None:
    bench.bus.accept((can301.SYNC_ID, b"", 0.0))


@pytest.mark.parametrize(
    ("prepare", "told"),
    [(_switch_on, "SWITCHED_ON"), (_another_master, "someone else sent 0x080")],
)
def test_a_drive_in_use_is_left_alone(
    bench: OnABus, prepare: Callable[[OnABus], None], told: str
) -> None:
    prepare(bench)
    bench.sent.clear()
    with pytest.raises(DeviceError, match=told):
        list(try_drive(bench.fieldbus, bench.node("s1"), power=True))
    assert all(data[:1] == b"\x40" for _, data in bench.sent)
    bench.fieldbus.clear_trouble()
    TriedDrive(bench.fieldbus, bench.node("s1")).put_back()
