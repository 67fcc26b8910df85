"""Steps of a campaign's scripts, and the draw that decides them."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..scripts.step import Step

Draw = np.random.Generator

Act = dict[str, Any]
"""One topic with its fields, or one generator, as in a script's file."""


def step(at_s: float, act: Mapping[str, Any]) -> Step:
    """Return a step of a script, checked like one from a file."""
    return Step.model_validate({"at_s": at_s, **act})
