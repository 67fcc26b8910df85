"""The part `fuzz` of the campaign: its jobs, and which module plays which."""

from collections.abc import Callable

from ..part import Part, Selection
from . import bus, codec, files, network
from .outcome import Endurance, Outcome

KINDS: dict[str, Callable[[int], Outcome]] = {
    "codec": codec.play,
    "network": network.play,
    "bus": bus.play,
    "files": files.play,
}
"""What is fuzzed, and who does it with a seed."""

Job = tuple[str, int]
"""Kind and seed."""


def _jobs(selection: Selection) -> list[Job]:
    return [(kind, seed) for seed in selection.seeds for kind in KINDS]


def _play(job: Job) -> Outcome:
    kind, seed = job
    return KINDS[kind](seed)


FUZZ = Part(_jobs, _play, Endurance)
