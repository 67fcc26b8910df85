"""Figures of a payload that several arms hold, by the physics' truth."""

import math
from collections.abc import Sequence

from ....protocols.messages.rig import RigTruth

LAST_S = 1.0
"""The mean internal force is that of so long before the end [s]."""


def beam_figures(truths: Sequence[RigTruth], period_s: float) -> dict[str, object]:
    """Return the figures for a simulation's JSON; none where the arms hold nothing.

    Internal force (the most, and the mean of the last second) and greatest push [N], greatest
    stretch and each peg's depth at the end [m].
    """
    beams = [truth.beam for truth in truths if truth.beam is not None]
    if not beams:
        return {}
    last = beams[-max(1, round(LAST_S / period_s)) :]
    return {
        "internal_force_n": {
            "max": max(beam.internal_force for beam in beams),
            "last_mean": math.fsum(beam.internal_force for beam in last) / len(last),
        },
        "stretch_m": max(beam.stretch for beam in beams),
        "peg_depth_m": list(beams[-1].peg_depth),
        "push_n": max(beam.push_peak for beam in beams),
    }
