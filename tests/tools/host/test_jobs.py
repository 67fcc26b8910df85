"""Many jobs, in any place: the same results, whoever dies or interrupts."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from telerobot.config.errors import ConfigError
from telerobot.tools.host.jobs import Place, WorkersDiedError, run_all

# Jobs are texts that a worker evaluates: it finds `eval` wherever it runs.
SUMS = [f"{i} + {i}" for i in range(6)]
DOUBLES = [2 * i for i in range(6)]


def dies_once(folder: Path) -> str:
    """A job that kills its worker when it is run first, in its second second; and is 7 then."""
    told = folder / "died"
    dies = "__import__('time').sleep(1.5), __import__('os').kill(__import__('os').getpid(), 9)"
    return (
        f"7 if __import__('os').path.exists({str(told)!r}) else "
        f"(open({str(told)!r}, 'w').close(), {dies})"
    )


def rows(path: Path) -> dict[str, object]:
    return {row["job"]: row["result"] for row in map(json.loads, path.read_text().splitlines())}


@pytest.mark.parametrize("processes", [1, 2])
def test_results_are_in_the_order_of_the_jobs_and_kept_as_lines(tmp_path, processes):
    file = tmp_path / "out/rows.jsonl"
    finished = run_all(eval, SUMS, Place(processes, rows=file), "sums")
    assert finished.results == DOUBLES
    assert not finished.interrupted
    assert rows(file) == {repr(job): 2 * i for i, job in enumerate(SUMS)}


def test_what_is_kept_is_not_run_again_and_a_line_that_was_cut_off_is(tmp_path):
    file = tmp_path / "rows.jsonl"
    file.write_text(
        json.dumps({"job": repr("0 + 0"), "result": 100}) + '\n{"job": "\'1 + 1\'", "re'
    )
    place = Place(rows=file, resume=True)
    assert run_all(eval, SUMS, place, "sums").results == [100, *DOUBLES[1:]]
    assert len(rows(file)) == len(SUMS)
    # Without `resume` all are run, and the file is made anew.
    assert run_all(eval, SUMS, Place(rows=file), "sums").results == DOUBLES
    assert len(file.read_text().splitlines()) == len(SUMS)


def test_a_file_of_something_else_is_refused_by_its_line(tmp_path):
    file = tmp_path / "rows.jsonl"
    file.write_text("ticks\n")
    with pytest.raises(ConfigError, match=r"rows.jsonl: line 1: no result of a job"):
        run_all(eval, SUMS, Place(rows=file, resume=True), "sums")


def test_a_killed_worker_is_named_and_its_job_is_run_again(tmp_path, capsys):
    job = dies_once(tmp_path)
    assert run_all(eval, [*SUMS, job], Place(2), "sums").results == [*DOUBLES, 7]
    (told,) = [line for line in capsys.readouterr().err.splitlines() if "died" in line]
    assert told.startswith("worker ")
    assert told.endswith(f"died: run again: {job!r}")


def test_a_job_that_kills_every_worker_ends_the_work_by_its_name():
    job = "__import__('os').kill(__import__('os').getpid(), 9)"
    with pytest.raises(WorkersDiedError, match="3 workers died of it"):
        run_all(eval, ["1", job], Place(2), "sums")


def test_an_error_of_a_job_comes_through():
    with pytest.raises(ZeroDivisionError):
        run_all(eval, ["1 / 0", "1"], Place(2), "sums")


def test_an_interrupted_work_keeps_what_is_done_and_goes_on_from_there(tmp_path):
    file = tmp_path / "rows.jsonl"
    jobs = ["1", "2", "__import__('time').sleep(600)", "__import__('time').sleep(600)"]
    source = (
        "import signal\nfrom pathlib import Path\n"
        "from telerobot.tools.host.jobs import Place, run_all\n"
        # A shell that runs the tests in its background ignores Ctrl-C, and hands that on.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"if __name__ == '__main__':\n    place = Place(2, rows=Path({str(file)!r}))\n"
        f"    print(run_all(eval, {jobs!r}, place, 'sums'))\n"
    )
    script = tmp_path / "script.py"
    script.write_text(source)
    # A group of its own, as a shell's: Ctrl-C reaches the workers, too.
    process = subprocess.Popen(
        [sys.executable, str(script)], stdout=-1, stderr=-1, text=True, start_new_session=True
    )
    try:
        while not file.exists() or file.read_text().count("\n") < 2:
            assert process.poll() is None
            os.sched_yield()
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert out == "Finished(results=[1, 2], interrupted=True)\n"
    assert err == f"sums: interrupted: 2 of 4 done, kept in {file}: --resume goes on\n"
    again = run_all(eval, [*jobs[:2], "3"], Place(rows=file, resume=True), "sums")
    assert again.results == [1, 2, 3]


def test_an_interruption_breaks_nothing_off():
    """Nothing is left half done, as a lock that is taken; it counts after what is being done."""
    heard = []

    def told(result):
        signal.raise_signal(signal.SIGINT)
        heard.append(result)
        return ""

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        finished = run_all(eval, ["1", "__import__('time').sleep(600)"], Place(2), "sums", told)
        assert signal.getsignal(signal.SIGINT) == signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert (heard, finished.results, finished.interrupted) == ([1], [1], True)


def test_an_interruption_at_the_last_result_is_told():
    """What asked for the work would begin the next one otherwise."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        finished = run_all(
            eval, ["1", "2"], Place(2), "sums", lambda _: signal.raise_signal(signal.SIGINT) or ""
        )
    finally:
        signal.signal(signal.SIGINT, before)
    assert finished.interrupted


def test_a_cluster_gives_the_same_though_a_worker_is_killed(tmp_path, capsys):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as cluster:
        address = cluster.scheduler_address.removeprefix("tcp://")
        job = dies_once(tmp_path)
        file = tmp_path / "rows.jsonl"
        finished = run_all(eval, [*SUMS, job], Place(cluster=address, rows=file), "sums")
    assert finished.results == [*DOUBLES, 7]
    assert rows(file) == {repr(job): 2 * i for i, job in enumerate(SUMS)} | {repr(job): 7}
    (told,) = [line for line in capsys.readouterr().err.splitlines() if "died" in line]
    assert told.startswith("worker tcp://")
    assert told.endswith(f"died: run again: {job!r}")


def test_a_cluster_that_is_not_there_is_told():
    pytest.importorskip("distributed")
    with pytest.raises(ConfigError, match=r"dask://127.0.0.1:9 does not answer"):
        run_all(eval, SUMS, Place(cluster="127.0.0.1:9"), "sums")
