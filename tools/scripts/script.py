"""Scripts: actions of operators, and events around the arm, over time, in TOML.

    duration_s = 6.0
    [[step]]
    at_s = 0.5
    for_s = 2.0
    "cmd/joystick" = { twist = [0.05, 0, 0, 0, 0, 0], expressed_in = "base" }
    [expect]
    mode = "enabled"

A step is a topic (`protocols/topics.py`) and the fields of its message. Times count from the moment
the arm is enabled. The same script drives a simulation and a running daemon.
"""

from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError
from pydantic_core import ErrorDetails

from ...config.load import ConfigError, read_toml, script_path
from .expectations import Expectations
from .generators.tables import Network, ScriptTable
from .step import Step

SAME_S = 1e-9
"""Steps that are no further apart happen at once [s]."""


class Script(ScriptTable):
    """A run: its length, its network, its steps."""

    description: str = ""
    duration_s: float = Field(gt=0, le=3600)
    auto_enable: bool = True
    """The operator takes the lease and enables the arm before time starts."""
    network: Network = Network()
    expect: Expectations = Expectations()
    """What the run is to reach."""
    step: tuple[Step, ...] = ()

    @property
    def steps(self) -> tuple[Step, ...]:
        """The steps in order of time; a stream with an end is followed by its silence."""
        steps = sorted(self.step, key=lambda step: step.at_s)
        ends = [end for i, step in enumerate(steps) if (end := _end(step, steps[i + 1 :]))]
        return tuple(sorted([*ends, *steps], key=lambda step: step.at_s))


def _end(step: Step, later: list[Step]) -> Step | None:
    """Return the silence after a stream's step; None without an end or before another step."""
    if step.for_s is None:
        return None
    end_s = step.at_s + step.for_s
    for other in later:
        if other.at_s > end_s + SAME_S:
            break
        if other.operator == step.operator and other.streams & step.streams:
            return None
    return Step(at_s=end_s, operator=step.operator, silence=tuple(step.streams))


def load_script(name_or_path: str | Path, base: Path = Path()) -> Script:
    """Load a script: a path, or the name of a shipped one. Raises `ConfigError`."""
    path = script_path(name_or_path, base)
    document = read_toml(path)
    try:
        return Script.model_validate(document)
    except ValidationError as error:
        raise ConfigError(f"{path}: {_explain(error.errors()[0], document)}") from None


def _explain(error: ErrorDetails, document: dict[str, Any]) -> str:
    """Return one error: the key, the time of its step, the value and the expectation."""
    loc, words = error["loc"], error["msg"].removeprefix("Value error, ")
    key = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in loc).removeprefix(".")
    match loc:
        case ("step", int(i), *_) if "at_s" in document["step"][i]:
            key += f" (at_s = {document['step'][i]['at_s']})"
    value = error["input"]
    shown = "" if isinstance(value, dict) else f"value {str(value)[:60]}: "
    return f"{key}: {shown}{words}"
