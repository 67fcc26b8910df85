"""The laboratory itself, on a module with a change that its tests do not notice."""

import importlib
import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent

PLANTED = '''
from functools import cache

MOST = 3.0

@cache
def capped(x: float) -> float:
    """Return x, at most MOST."""
    return MOST if x > MOST else x

class Counter:
    """Counts down."""

    step: int = 1

    def steps(self, n: int = 3) -> int:
        done = 0
        while n > 0:
            n -= self.step
            done += 1
        return done
'''
TESTS = """
from planted import Counter, capped

def test_what_is_small_stays():
    assert capped(1.0) == 1.0

def test_what_is_large_is_capped():
    assert capped(5.0) == 3.0

def test_a_counter_ends():
    assert Counter().steps() == 3
"""


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """What is told of the planted module's mutants."""
    folder = tmp_path_factory.mktemp("planted")
    (folder / "planted.py").write_text(PLANTED)
    (folder / "test_planted.py").write_text(TESTS)
    done = subprocess.run(
        [sys.executable, HERE / "session.py", "planted", "", "test_planted.py"],
        cwd=folder, env={**os.environ, "PYTHONPATH": str(folder)}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_the_one_change_that_no_test_notices_lives_on(rows):
    assert not [row for row in rows if "error" in row]
    alive = [f"{row['scope']}: {row['change']}" for row in rows if not row.get("killed", True)]
    assert alive == ["capped: return MOST if x > MOST else x → return MOST if x >= MOST else x"]


def test_every_kind_of_change_is_tried_and_the_rest_is_noticed(rows):
    killed = {f"{row['scope']}: {row['change']}" for row in rows if row.get("killed")}
    assert killed >= {
        ": MOST = 3.0 → MOST = 6.0",
        "capped: return MOST if x > MOST else x → return MOST if x <= MOST else x",
        "capped: return MOST if x > MOST else x → return None",
        "Counter: step: int = 1 → step: int = 2",
        "Counter.steps: n -= self.step → n += self.step",
        "Counter.steps: while n > 0: → while n >= 0:",
    }
    assert rows[0]["mutants"] == len(rows) - 2


def test_a_loop_without_an_end_is_noticed_by_its_time(rows):
    (row,) = [row for row in rows if row.get("change") == "n -= self.step → pass"]
    assert row["killed"]
    assert row["by"] == "time"


def test_the_list_of_survivors_is_held_to_what_lives_on(monkeypatch):
    monkeypatch.syspath_prepend(str(HERE))
    from run import Verdict

    verdict = Verdict("room.module", whole=True)
    verdict.take({"mutants": 20})
    for i in range(20):
        verdict.take({"scope": "f", "change": f"{i}", "killed": i > 0})
    assert verdict.wrong({"f: 0": "it says the same"}, True) == []
    (unlisted,) = verdict.wrong({}, True)
    assert "f: 0" in unlisted
    assert verdict.wrong({"f: 0": ""}, True) == [unlisted]
    killed, gone = verdict.wrong({"f: 0": "same", "f: 1": "same", "g: 1": "same"}, True)
    assert "f: 1" in killed
    assert "g: 1" in gone
    verdict.take({"scope": "f", "change": "20", "killed": False})
    verdict.mutants = 21
    few = verdict.wrong({"f: 0": "same", "f: 20": "same"}, True)
    assert [line.endswith("less than 95%") for line in few] == [True]


def test_two_statements_that_say_the_same_are_two_mutants(monkeypatch):
    monkeypatch.syspath_prepend(str(HERE))
    from mutations import mutants_of

    found = [m.change for m in mutants_of("def f(x):\n    x += 1\n    x += 1\n    return x\n")]
    assert "x += 1 → x -= 1" in found
    assert "x += 1 → x -= 1  #2" in found
    assert len(found) == len(set(found))


def test_the_programme_names_modules_and_tests_that_are_there(monkeypatch):
    monkeypatch.syspath_prepend(str(HERE))
    run = importlib.import_module("run")
    assert run.lost(tomllib.loads(run.SURVIVORS.read_text())) == []
    monkeypatch.setitem(run.TARGETS, "server.gone", ("tests/server/gone",))
    assert run.lost(["server.left"]) == [
        "server.gone: no such module",
        "server.gone: no tests tests/server/gone",
        "server.left: is in survivors.toml, and is no module here",
    ]
