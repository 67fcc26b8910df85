"""What scripts of a campaign are made with: steps, and the draw that decides."""

from typing import Any

import numpy as np

from ..scripts.script import Step

Draw = np.random.Generator


def step(at_s: float, **what: Any) -> Step:
    """Return a step of a script, checked like one from a file."""
    return Step.model_validate({"at_s": at_s, **what})
