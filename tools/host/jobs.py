"""One runner of long works: many jobs, in processes of this machine or on a Dask cluster.

A job is a plain value, its work a function of a module: where it runs changes nothing of what comes
out. A result is kept as a line of JSON at once, and an interrupted work goes on from there.
"""

import argparse
import json
import os
import signal
import sys
from collections import Counter, deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final, Generic, Self, TypeVar

from tqdm import tqdm

from ...config.errors import ConfigError, printable

DEATHS: Final = 3  # a job whose worker has died so often is given up [1]
LOOK_S: Final = 1.0  # time between two looks at who interrupts, or which workers are there [s]
DIAL_S: Final = 10.0  # time that a cluster has to answer [s]
SCHEME: Final = "dask://"

J = TypeVar("J")
R = TypeVar("R")


class WorkersDiedError(OSError):
    """A job ended its worker again and again."""


@dataclass(frozen=True)
class Place:
    """Where jobs run, and what keeps their results."""

    processes: int = 1
    cluster: str = ""  # HOST:PORT of a Dask scheduler; empty: processes of this machine
    rows: Path | None = None  # a file that takes a line of JSON for each result
    resume: bool = False  # jobs whose results stand there are not run again


@dataclass(frozen=True)
class Finished(Generic[R]):
    """Results in the order of the jobs, without those that an interruption left out."""

    results: list[R]
    interrupted: bool


def place_of(args: argparse.Namespace) -> Place:
    """Return what the arguments chose. Raises `ConfigError`."""
    if args.resume and args.rows is None:
        raise ConfigError("--resume: --rows names no file to go on from")
    return Place(args.jobs, args.cluster or "", args.rows, args.resume)


def run_all(
    work: Callable[[J], R],
    jobs: Sequence[J],
    place: Place,
    what: str,
    told: Callable[[R], str] = lambda _: "",
    pack: Callable[[J, R], object] = lambda _, result: result,
    unpack: Callable[[J, Any], R] = lambda _, kept: kept,
    named: Callable[[J], str] = repr,
) -> Finished[R]:
    """Run every job; return the results in their order, or those there were when interrupted.

    `what` says what they are, `told` what is said of a result, and a job is `named` by what makes
    it the same again; `pack` makes a result JSON, `unpack` reads it. Raises `WorkersDiedError`,
    `ConfigError`, and what a job raised.
    """
    names = [named(job) for job in jobs]
    results: dict[int, R] = {}
    if place.rows is not None and place.resume:
        kept = dict(_kept(place.rows))
        results = {i: unpack(jobs[i], kept[n]) for i, n in enumerate(names) if n in kept}
    left = [i for i in range(len(jobs)) if i not in results]
    interrupted = False
    with (
        _Rows(place.rows, place.resume) as rows,
        tqdm(total=len(jobs), initial=len(results), desc=what, unit=" jobs", disable=None) as bar,
    ):
        # Closed at once, with its workers: a generator that is left may live on with a traceback.
        ended = _ended(work, jobs, left, names, place)
        try:
            for i, result in ended:
                results[i] = result
                rows.add(names[i], pack(jobs[i], result))
                bar.update()
                if line := told(result):
                    _say(line)
        except KeyboardInterrupt:
            interrupted = True
        finally:
            ended.close()
    if interrupted:
        kept_in = f", kept in {place.rows}: --resume goes on" if place.rows else ""
        _say(f"{what}: interrupted: {len(results)} of {len(jobs)} done{kept_in}")
    return Finished([results[i] for i in sorted(results)], interrupted)


def _ended(
    work: Callable[[J], R], jobs: Sequence[J], left: list[int], names: list[str], place: Place
) -> Generator[tuple[int, R], None, None]:
    if place.cluster:
        return _on_cluster(work, jobs, left, names, place.cluster)
    if place.processes == 1 or len(left) == 1:
        return ((i, work(jobs[i])) for i in left)
    return _on_processes(work, jobs, left, names, place.processes)


class _Lane:
    """A process that runs one job at a time: whose worker dies is known, and at which job."""

    def __init__(self) -> None:
        # Spawned: a run must depend on its job alone. Ctrl-C is for who hands out the jobs.
        ignored = signal.SIGINT, signal.SIG_IGN
        self._pool = ProcessPoolExecutor(1, get_context("spawn"), signal.signal, ignored)
        self.pid = self._pool.submit(os.getpid).result()

    def submit(self, work: Callable[[J], R], job: J) -> "Future[R]":
        return self._pool.submit(work, job)

    def close(self) -> None:
        with suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGTERM)
        self._pool.shutdown(cancel_futures=True)


def _on_processes(
    work: Callable[[J], R], jobs: Sequence[J], left: list[int], names: list[str], processes: int
) -> Generator[tuple[int, R], None, None]:
    waiting, deaths = deque(left[processes:]), Counter[int]()
    running: dict[Future[R], tuple[_Lane, int]] = {}
    lanes: list[_Lane] = []
    # Raised wherever it comes, Ctrl-C could leave a future's lock taken, and end nothing.
    interrupts: list[int] = []
    before = signal.getsignal(signal.SIGINT)
    if before != signal.SIG_IGN:
        signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))
    try:
        for i in left[:processes]:
            lanes.append(_Lane())
            running[lanes[-1].submit(work, jobs[i])] = lanes[-1], i
        while running and not interrupts:
            for future in wait(running, LOOK_S, FIRST_COMPLETED).done:
                lane, i = running.pop(future)
                try:
                    yield i, future.result()
                except BrokenProcessPool:
                    deaths[i] += 1
                    if deaths[i] == DEATHS:
                        raise WorkersDiedError(f"{names[i]}: {DEATHS} workers died of it") from None
                    _say(f"worker {lane.pid} died: run again: {names[i]}")
                    waiting.appendleft(i)
                    lanes[lanes.index(lane)] = lane = _Lane()
                if waiting:
                    i = waiting.popleft()
                    running[lane.submit(work, jobs[i])] = lane, i
    finally:
        for lane in lanes:
            lane.close()
        signal.signal(signal.SIGINT, before)
    if interrupts:
        raise KeyboardInterrupt


def _on_cluster(
    work: Callable[[J], R], jobs: Sequence[J], left: list[int], names: list[str], address: str
) -> Generator[tuple[int, R], None, None]:
    try:
        import distributed
    except ModuleNotFoundError:
        raise ConfigError("--cluster needs Dask: pip install 'telerobot[cluster]'") from None
    try:
        client: Any = distributed.Client(f"tcp://{address}", timeout=DIAL_S, set_as_default=False)
    except OSError as error:
        raise ConfigError(f"--cluster: {SCHEME}{address} does not answer: {error}") from None
    ended: SimpleQueue[Any] = SimpleQueue()
    with client:
        futures = {client.submit(work, jobs[i], pure=False): i for i in left}
        try:
            for future in futures:
                future.add_done_callback(ended.put)
            left_open = {future.key: i for future, i in futures.items()}
            held = client.processing()
            while left_open:
                try:
                    future = ended.get(timeout=LOOK_S)
                except Empty:
                    future = None
                now = client.processing()
                for worker in held.keys() - now.keys():
                    lost = [names[left_open[key]] for key in held[worker] if key in left_open]
                    _say(f"worker {worker} died: run again: {', '.join(lost) or 'nothing'}")
                held = now
                if future is None:
                    continue
                i = left_open.pop(future.key)
                try:
                    yield i, future.result()
                except distributed.KilledWorker:
                    raise WorkersDiedError(f"{names[i]}: its workers die of it") from None
        finally:
            client.cancel(list(futures), force=True)


class _Rows:
    """A file that takes a line for each result, at once."""

    def __init__(self, path: Path | None, resume: bool) -> None:
        self._file = None
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            whole = path.read_bytes() if resume and path.exists() else b""
            # A line that was cut off, as by a power failure, is none.
            path.write_bytes(whole[: whole.rfind(b"\n") + 1])
            self._file = path.open("a", encoding="utf-8")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()

    def add(self, name: str, result: object) -> None:
        if self._file is not None:
            row = {"job": name, "result": result}  # JSON knows no NumPy scalars
            self._file.write(json.dumps(row, default=lambda number: number.item()) + "\n")
            self._file.flush()


def _kept(path: Path) -> Generator[tuple[str, Any], None, None]:
    """Yield name and result of all jobs whose results a file holds. Raises `ConfigError`."""
    if not path.exists():
        return
    for number, line in enumerate(path.read_text(encoding="utf-8").split("\n")[:-1], start=1):
        try:
            row = json.loads(line)
            yield row["job"], row["result"]
        except (ValueError, KeyError, TypeError):
            raise ConfigError(f"{path}: line {number}: no result of a job") from None


def seeds(text: str) -> range:
    """Return the seeds A to B - 1 of the text "A:B", or only A of "A"."""
    first, colon, last = text.partition(":")
    try:
        found = range(int(first), int(last) if colon else int(first) + 1)
    except ValueError:
        found = range(0)
    if not found or found.start < 0:
        raise argparse.ArgumentTypeError(f"{text}: must be A:B with 0 <= A < B")
    return found


def count(text: str) -> int:
    """Return a number of 1 or more of the command line."""
    count = int(text) if text.isdecimal() else 0
    if count < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be a number of 1 or more")
    return count


def cluster(text: str) -> str:
    """Return HOST:PORT of the text "dask://HOST:PORT"."""
    address = text.removeprefix(SCHEME)
    host, _, port = address.rpartition(":")
    if not text.startswith(SCHEME) or not host or not port.isdecimal():
        raise argparse.ArgumentTypeError(f"{text}: must be {SCHEME}HOST:PORT")
    return address


def _say(line: str) -> None:
    tqdm.write(printable(line), file=sys.stderr)
