"""Part `fuzz` of the campaign: its jobs and their players."""

from collections.abc import Callable

from ..part import Part, Selection
from . import bus, codec, files, network, wire
from .outcome import Endurance, Outcome

KINDS: dict[str, Callable[[int], Outcome]] = {
    "codec": codec.play,
    "network": network.play,
    "bus": bus.play,
    "files": files.play,
    "wire": wire.play,
}
"""Fuzzed interfaces, and the function that plays a seed of each."""

Job = tuple[str, int]
"""Kind and seed."""


def _jobs(selection: Selection) -> list[Job]:
    every = {"wire": wire.EVERY}  # processes take their time
    return [
        (kind, seed)
        for i, seed in enumerate(selection.seeds)
        for kind in KINDS
        if i % every.get(kind, 1) == 0
    ]


def _play(job: Job) -> Outcome:
    kind, seed = job
    return KINDS[kind](seed)


FUZZ = Part(_jobs, _play, Endurance)
