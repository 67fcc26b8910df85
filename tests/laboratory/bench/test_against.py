"""Two revisions side by side: which figures are compared, and what is checked out."""

import subprocess

import pytest
from laboratory.bench.against import checked_out, compared, leaves
from telerobot.drivers.device import DeviceError


def told(p50: float, rounds: int = 3) -> dict:
    return {
        "machine": {"cores": 2, "load_1min": p50},
        "quick": False,
        "tick": {"pa10": {"free_us": {"p50": p50, "max": 0.0}, "met": True, "rounds": rounds}},
    }


def test_figures_are_those_that_were_measured():
    found = leaves(told(200.0))
    assert found[("tick", "pa10", "free_us", "p50")] == 200.0
    assert not [where for where in found if "machine" in where or "met" in where]


def test_a_ratio_is_of_one_round_and_a_figure_the_median_of_all():
    before = [leaves(told(p50)) for p50 in (200.0, 100.0, 400.0)]
    now = [leaves(told(p50)) for p50 in (100.0, 100.0, 100.0)]
    # What is zero has no ratio, and what nobody measured does not count: one row is left.
    ((where, was, new, ratios),) = compared(before, now)
    assert where == ("tick", "pa10", "free_us", "p50")
    assert (was, new) == (200.0, 100.0)
    assert ratios == [0.5, 1.0, 0.25]


def test_what_one_of_them_does_not_measure_is_left_out():
    other = {"tick": {"ur5e": {"free_us": {"p50": 1.0}}}}
    assert list(compared([leaves(told(1.0))], [leaves(other)])) == []


@pytest.fixture
def repository(tmp_path):
    def git(*arguments: str) -> None:
        who = ["-c", "user.name=a", "-c", "user.email=a@localhost"]
        subprocess.run(["git", *who, *arguments], cwd=tmp_path, check=True, capture_output=True)

    git("init", "--quiet")
    for word in ("first", "second"):
        (tmp_path / "word").write_text(word)
        git("add", "word")
        git("commit", "--quiet", "-m", word)
    return tmp_path


def test_another_revision_stands_beside_this_one_for_as_long_as_it_is_measured(repository):
    with checked_out(repository, "HEAD~1") as tree:
        assert (tree / "word").read_text() == "first"
        assert (repository / "word").read_text() == "second"
    assert not tree.exists()
    left = subprocess.run(
        ["git", "worktree", "list"], cwd=repository, check=True, capture_output=True, text=True
    )
    assert len(left.stdout.splitlines()) == 1


def test_a_revision_that_there_is_not_is_named(repository):
    with (
        pytest.raises(DeviceError, match=r"--against nowhere: .*nowhere"),
        checked_out(repository, "nowhere"),
    ):
        pass
