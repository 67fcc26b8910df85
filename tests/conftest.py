"""What each test may cost; and a small cell of three joints, as files that a test may spoil."""

import gc
import os
import random
import resource
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

# As the commands have it, however the tests are started; must stand before numpy is imported.
# Several threads that wait for each other in a small matrix cost up to forty times its time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from telerobot.config.load import load_cell
from telerobot.drivers.device import DeviceError

SLOW = Path(__file__).with_name("slow.txt")
"""Names the tests that `make test` leaves out, as `make durations` measured them."""
SLOW_S, FAST_S = 0.4, 5.0
"""A test that is measured above the first is slow; one that is not may cost the second [CPU s]."""
MAY = {"slow", "hil", "browser"}
"""Marks of tests that may cost more; those of processes wait, and are not measured."""

_began_s = time.monotonic()

if sys.dont_write_bytecode:
    # Each worker would spend more on rewriting all tests' asserts than on collecting them.
    sys.pycache_prefix = str(SLOW.parents[1] / ".pytest_cache" / "bytecode")
    sys.dont_write_bytecode = False

_shared: defaultdict[tuple[str, str], float] = defaultdict(float)
"""What fixtures cost that several tests share, by name and where they are shared [CPU s]."""
_asked: dict[Any, tuple[float, float]] = {}
"""Costs of what the running test had from `shared`, and how much of each was spent now [CPU s]."""
_costs: dict[str, float] = {}

P, R = ParamSpec("P"), TypeVar("R")


def shared(make: Callable[P, R]) -> Callable[P, R]:
    """Make a thing once for all tests that ask for it; each of them is charged with its cost.

    So a run of seconds marks all tests of it as slow, and not the one that happens to come first.
    """
    made: dict[Any, tuple[R, float]] = {}

    @wraps(make)
    def ask(*args: P.args, **kwargs: P.kwargs) -> R:
        key, now_s = (args, tuple(sorted(kwargs.items()))), 0.0
        if key not in made:
            began = _cpu_s()
            thing = make(*args, **kwargs)
            now_s = _cpu_s() - began
            made[key] = (thing, now_s)
        thing, cost = made[key]
        _asked.setdefault((ask, key), (cost, now_s))
        return thing

    return ask


def _cpu_s() -> float:
    whose = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(use.ru_utime + use.ru_stime for use in map(resource.getrusage, whose))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--measure", action="store_true", help=f"write {SLOW.name} by this run's cost")
    parser.addoption(
        "--until",
        type=float,
        metavar="S",
        help="leave slow tests out that would begin after so long",
    )
    parser.addoption(
        "--order",
        metavar="SEED",
        help="slow tests come last, their files as this text shuffles them",
    )


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Keep the garbage collector off: it would go through thousands of tests again and again.

    What is there then stays out of its way: to go through it takes up to half a second, and so long
    without a word costs a process its lease.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    slow = set(SLOW.read_text().splitlines())
    known = {name for item in items for name in _names(item)}
    whole = not any("::" in arg for arg in config.args)
    files = {name.partition("::")[0] for name in known} if whole else set()
    gone = {name for name in slow - known if name.partition("::")[0] in files}
    if gone and not config.option.measure:
        raise pytest.UsageError(f"{SLOW.name} names {min(gone)}, and there is none: make durations")
    for item in items:
        if slow.intersection(_names(item)):
            item.add_marker("slow")
    if (seed := config.option.order) is not None:

        def last(item: pytest.Item) -> float:
            file = item.nodeid.partition("::")[0]
            slow = item.get_closest_marker("slow") is not None
            return random.Random(f"{seed} {file}").random() if slow else -1.0

        items.sort(key=last)


def pytest_runtest_setup(item: pytest.Item) -> None:
    until_s = item.config.option.until
    late = until_s is not None and time.monotonic() - _began_s > until_s
    if late and item.get_closest_marker("slow"):
        pytest.skip(f"{until_s:.0f} s are over: the rest of the slow tests is left out")


def _names(item: pytest.Item) -> tuple[str, str]:
    """Return how a test may be named: with its parameters, and all of its function."""
    return item.nodeid, item.nodeid.partition("[")[0]


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(
    fixturedef: pytest.FixtureDef[Any], request: pytest.FixtureRequest
) -> Generator[None, Any, Any]:
    began = _cpu_s()
    try:
        return (yield)
    finally:
        _shared[fixturedef.argname, request.node.nodeid] += _cpu_s() - began


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """Fail a test that costs too much; what it shares is part of what each costs."""
    _asked.clear()
    began = _cpu_s()
    result = yield
    spent = _cpu_s() - began + sum(cost - now_s for cost, now_s in _asked.values())
    nodes, fixtures = item.listchain(), getattr(item, "fixturenames", ())
    shared = sum(_shared.get((name, node.nodeid), 0.0) for name in fixtures for node in nodes)
    item.user_properties.append(("cpu_s", spent + shared))
    marks = {mark.name for mark in item.iter_markers()}
    if spent > FAST_S and marks.isdisjoint(MAY) and not item.config.option.measure:
        pytest.fail(f"it cost {spent:.1f} CPU s of {FAST_S:.0f}: make it quicker, or durations")
    return result


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.when == "call":
        _costs[report.nodeid] = dict(report.user_properties).get("cpu_s", 0.0)


def pytest_sessionfinish(session: pytest.Session) -> None:
    if not session.config.option.measure or hasattr(session.config, "workerinput"):
        return
    before = SLOW.read_text().splitlines()
    root = SLOW.parents[1]
    there = [name for name in before if (root / name.partition("::")[0]).is_file()]
    slow = slow_names(_costs, there)
    SLOW.write_text("".join(f"{name}\n" for name in slow))
    total, left = sum(_costs.values()), sum(c for c in _costs.values() if c <= SLOW_S)
    print(f"\n{len(slow)} lines in {SLOW.name}; {total:.0f} CPU s in all, {left:.0f} in fast tests")


def slow_names(costs: Mapping[str, float], before: Iterable[str]) -> list[str]:
    """Return the names of slow tests by their costs [CPU s], and those `before` of other files.

    A test is named with its parameters where others of its function are quick.
    """
    rows: defaultdict[str, dict[str, float]] = defaultdict(dict)
    for name, cost in costs.items():
        rows[name.partition("[")[0]][name] = cost
    measured = {name.partition("::")[0] for name in costs}
    slow = [name for name in before if name.partition("::")[0] not in measured]
    for function, each in rows.items():
        above = [name for name, cost in each.items() if cost > SLOW_S]
        slow += [function] if len(above) == len(each) else above
    return sorted(slow)


_LINK = (
    '<link name="{0}"><inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" '
    'iyz="0" izz="0.01"/></inertial>'
    '<collision><geometry><sphere radius="0.05"/></geometry></collision></link>'
)
_JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>'
    '<origin xyz="0 0 0.4"/><axis xyz="{3}"/>'
    '<limit lower="-2.5" upper="2.5" velocity="2" effort="100"/></joint>'
)
URDF = "\n".join(
    [
        '<robot name="small">',
        *(_LINK.format(name) for name in ("base", "l1", "l2", "l3", "tip", "finger")),
        _JOINT.format("j1", "base", "l1", "0 0 1"),
        _JOINT.format("j2", "l1", "l2", "0 1 0"),
        _JOINT.format("j3", "l2", "l3", "0 1 0"),
        '<joint name="mount" type="fixed"><parent link="l3"/><child link="tip"/>'
        '<origin xyz="0 0 0.3"/></joint>',
        _JOINT.format("grip", "tip", "finger", "1 0 0"),
        "</robot>",
    ]
)

_DRIVE = """
[[mechanism.drives]]
joint = "j{0}"
node = {0}
counts_per_radian = 2670176.8
rated_torque = 40.0
max_torque = 80.0
max_velocity = 1.5
max_acceleration = 10.0
max_jerk = 200.0
"""
CELL = (
    """name = "small"
default_script = "pose_move"

[timing]
period_s = 0.01

[mechanism]
name = "small"
urdf = "small.urdf"
tip_link = "tip"
postures = { start = [0.0, 0.5, 1.0], ready = [0.3, 0.6, 1.0] }
"""
    + "".join(_DRIVE.format(i) for i in (1, 2, 3))
    + """
[mechanism.force_torque]
rate_hz = 200

[sources.force]
gain = [7e-4, 7e-4, 7e-4, 0.03, 0.03, 0.03]

[touch]
torque = [9.0]

[rig.drive]
stiffness = [9000.0]
damping = [300.0]
integral = [0.0]
armature = [1.0, 1.0, 0.5]
friction = [1.0]
"""
)

TWO_ARMS = """name = "two"
default_script = "pa10_tour"
[[buses]]
name = "one"
channel = "239.74.163.30"
[[buses]]
name = "other"
channel = "239.74.163.31"
[[mechanisms]]
name = "left"
like = "{}"
bus = "one"
{}
[[mechanisms]]
name = "right"
like = "{}"
bus = "other"
{}
"""


@dataclass(frozen=True)
class CellFiles:
    """A cell file and its URDF in a directory of their own."""

    cell: Path
    urdf: Path

    def replace(self, old: str, new: str) -> Path:
        """Change the cell file's text; return its path."""
        return _replace(self.cell, old, new)

    def replace_in_urdf(self, old: str, new: str) -> Path:
        """Change the URDF's text; return the cell file's path."""
        _replace(self.urdf, old, new)
        return self.cell


def _replace(path: Path, old: str, new: str) -> Path:
    text = path.read_text()
    assert old in text, f"{path.name} does not say {old!r}"
    path.write_text(text.replace(old, new))
    return path


@pytest.fixture
def small(tmp_path: Path) -> CellFiles:
    """Return the files of a sound cell with three joints."""
    files = CellFiles(tmp_path / "small.toml", tmp_path / "small.urdf")
    files.cell.write_text(CELL)
    files.urdf.write_text(URDF)
    return files


@pytest.fixture(scope="session")
def two_arms(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Return a function that writes a cell of two arms, "left" and "right", with a bus each.

    It takes `like` which shipped cells they are, their bases as places along World's y [m] or as
    TOML, what else each says as its `own`, and what `more` the file says; it returns the file.
    """

    def write(
        like: tuple[str, str] = ("pa10", "ur5e"),
        bases: tuple[float | str, float | str] = (0.55, -0.60),
        own: tuple[str, str] = ("", ""),
        more: str = "",
    ) -> Path:
        texts: list[str] = []
        for name, base, said in zip(like, bases, own, strict=True):
            place = base if isinstance(base, str) else f"xyz = [0.0, {base}, 0.0]"
            texts += [name, f"T_world_base = {{ {place} }}\n{said}"]
        path = tmp_path_factory.mktemp("two") / "two.toml"
        path.write_text(TWO_ARMS.format(*texts) + more)
        return path

    return write


@pytest.fixture(scope="session")
def rendering() -> None:
    """Skip, with the reason, where no pictures can be made."""
    try:
        from telerobot.drivers.rig.physics.camera import RigCameras

        RigCameras(load_cell("pa10_vision")).close()
    except DeviceError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def opengl(rendering: None) -> None:
    """Skip, with the reason, where pictures are drawn, and not rendered by MuJoCo."""
    from telerobot.drivers.rig.physics.camera import RigCameras

    cameras = RigCameras(load_cell("pa10_vision"))
    cameras.close()
    if cameras.drawn:
        pytest.skip(f"no OpenGL: {cameras.drawn}")
