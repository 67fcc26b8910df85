"""telerobot: an open control server for remote robot arms."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .config.load import load_cell
    from .tools.client.operator import Operator, OperatorError
    from .tools.simulation.operator import SimulatedOperator
    from .tools.simulation.simulation import simulate

__all__ = ["Operator", "OperatorError", "SimulatedOperator", "load_cell", "simulate"]

_HOMES = {
    "Operator": ".tools.client.operator",
    "OperatorError": ".tools.client.operator",
    "SimulatedOperator": ".tools.simulation.operator",
    "load_cell": ".config.load",
    "simulate": ".tools.simulation.simulation",
}


def __getattr__(name: str) -> object:
    """Import a name when it is first used, so that a script pays only for what it takes."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value: object = getattr(import_module(_HOMES[name], __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
