import ast
import os
import subprocess
import sys
import tomllib
from collections import defaultdict
from importlib import resources
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("config", "drivers", "protocols", "server", "tools")


def test_the_package_is_the_five_folders():
    links = {p.name: p.resolve() for p in (ROOT / ".namespace/telerobot").iterdir()}
    links.pop("__pycache__", None)  # Python's, where it may write there
    assert links == {
        name: ROOT / name for name in (*FOLDERS, "__init__.py", "__main__.py", "py.typed")
    }


def test_the_laboratory_is_folders_of_the_tests_what_builds_need_and_what_tutorials_run():
    links = {p.name: p.resolve() for p in (ROOT / ".namespace/laboratory").glob("[a-z]*")}
    assert links.pop("vendor") == ROOT / "vendor"
    assert links.pop("tutorials") == ROOT / "docs/tutorials"
    assert links == {name: ROOT / "tests" / name for name in links}
    assert "campaign" in links


def test_links_are_relative_so_that_the_tree_can_move():
    links = [p for p in (ROOT / ".namespace").glob("*/*") if p.is_symlink()]
    assert links
    assert not any(p.readlink().is_absolute() for p in links)


def test_rewritten_tests_are_kept_whatever_the_environment_says_of_bytecode():
    assert not sys.dont_write_bytecode


@pytest.mark.parametrize(
    "first", ["import runpy; runpy.run_path('tests/conftest.py')", "import laboratory.campaign"]
)
def test_matrices_are_computed_on_one_thread_whatever_the_environment_says(first):
    """Else a test, or a run, is charged for threads that wait for a processor."""
    code = f"{first}; import os, numpy; print(len(os.listdir('/proc/self/task')))"
    bare = {key: value for key, value in os.environ.items() if key != "OPENBLAS_NUM_THREADS"}
    ran = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=bare, capture_output=True, check=True
    )
    assert int(ran.stdout) == 1


def test_data_travels_with_the_package():
    config = Path(str(resources.files("telerobot") / "config"))
    for kind, suffix in (("cells", ".toml"), ("robots", ".urdf")):
        assert list((config / kind).glob(f"*{suffix}")), f"no {suffix} in config/{kind}"


def test_constraints_name_versions_only_and_cover_what_we_need():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pinned = dict(line.split("==") for line in lines)
    told = tomllib.loads((ROOT / "pyproject.toml").read_text())
    needed = (*told["project"]["dependencies"], *told["dependency-groups"]["dev"])
    assert {n.split(">=")[0].lower() for n in needed} <= {name.lower() for name in pinned}


def modules(*folders):
    return [path for folder in folders for path in (ROOT / folder).rglob("*.py")]


def test_no_public_class_is_defined_twice_in_a_room():
    where: defaultdict[tuple[Path, str], set[str]] = defaultdict(set)
    for path in modules(*FOLDERS):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                where[path.parent, node.name].add(path.name)
    assert {name: sorted(files) for (_, name), files in where.items() if len(files) > 1} == {}


def test_no_test_builds_a_cell_by_copies_of_its_tables():
    """`altered` names the keys that are other ones, and a misspelt one is an error."""
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in modules("tests")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute)
        and node.attr == "model_copy"
        and "config" in ast.unparse(node.value).split(".")
        and path.name != "test_altered.py"
    ]
    assert found == []


def test_tests_of_rooms_that_were_not_measured_stay_as_slow_as_they_were(request):
    slow_names = request.config.pluginmanager.get_plugin(str(ROOT / "tests/conftest.py")).slow_names
    before = ["tests/a.py::gone", "tests/b.py::one", "tests/b.py::two[x]"]
    costs = {"tests/a.py::f[1]": 2.0, "tests/a.py::f[2]": 0.1, "tests/a.py::g[1]": 9.0}
    assert slow_names(costs, before) == ["tests/a.py::f[1]", "tests/a.py::g", *before[1:]]


def test_slow_tests_that_would_begin_too_late_are_left_out_and_counted():
    told = _pytest("--until", "0", "-rs", "-m", "slow", "tests/drivers/test_scanner.py")
    assert "SKIPPED [1]" in told
    assert "0 s are over" in told


def test_slow_tests_come_last_and_their_files_in_the_order_of_a_text():
    files = [str(path.relative_to(ROOT)) for path in (ROOT / "tests/simulation/units").glob("*.py")]
    orders = []
    for seed in ("one", "other"):
        told = _pytest("--collect-only", "--order", seed, *files).splitlines()
        orders.append([name for name in told if "::" in name])
    slow = set((ROOT / "tests/slow.txt").read_text().splitlines())
    last = [bool({name, name.partition("[")[0]} & slow) for name in orders[0]]
    assert last == sorted(last)
    assert orders[0] != orders[1]
    assert sorted(orders[0]) == sorted(orders[1])


def _pytest(*arguments):
    ran = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", *arguments],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return ran.stdout
