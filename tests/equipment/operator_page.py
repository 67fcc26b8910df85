"""The page of `telerobot.Operator`: `python -m laboratory.equipment.operator_page`."""

import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from telerobot.tools.client.operator import Motions, Operator, TaskClient

PAGE: Final = Path(inspect.getfile(Operator)).with_name("README.md")

INTRODUCTION: Final = """\
# `telerobot.Operator`

<!-- made by `python -m laboratory.equipment.operator_page` -->

A remote operator in Python: the lease, motions, settings and telemetry of one cell.

```python
from telerobot import Operator, OperatorError

with Operator("pa10") as operator:  # a shipped cell, or the path of yours
    operator.acquire()
    operator.enable()
    operator.posture("ready")
    if not operator.wait_goal(20.0):
        raise SystemExit("the posture was not reached")
    operator.joystick([0.0, 0.0, 0.02, 0.0, 0.0, 0.0], seconds=2.0, expressed_in="base")
    print(operator.wait_state().pose_mrf)
```

Units are SI: m, rad, s, N, N·m; a twist is `[vx, vy, vz, wx, wy, wz]`, a pose `xyz` and `rpy`
(fixed axes, Rz·Ry·Rx). Every refusal is an `OperatorError` with `reason` and `detail`. `request`,
`command` and `stream` send anything that `protocols/topics.py` has a row for: gains, switches,
desired wrench, payload, tare, obstacles, avoidance. `SimulatedOperator("pa10")` is an `Operator`
whose cell runs in its own process, in virtual time.
[A program to begin from](../../docs/tutorials/policy.py).
"""

SESSION: Final = (
    "acquire", "release", "holds_lease", "enable", "hold", "disable", "reset", "protective_stop",
    "clear_protective_stop", "wait_mode", "close",
)  # fmt: skip
OTHERS: Final = ("request", "sent", "command", "stream", "end_stream", "need_lease", "spin")
WATCHING: Final = ("state", "task_state", "cell_state", "wait_state", "events", "spin", "turn")


def page() -> str:
    """Return the page in Markdown."""
    described = inspect.cleandoc(Operator.__doc__ or "")
    lines = [INTRODUCTION, inspect.cleandoc(described), ""]
    own = [name for name, _ in _public(Operator)]
    motions = [name for name in vars(Motions) if name in own and name not in (*OTHERS, *WATCHING)]
    rest = [n for n in own if n not in (*SESSION, *WATCHING, *motions)]
    for heading, names in (
        ("Lease and mode", SESSION),
        ("Motion", motions),
        ("What the cell tells", WATCHING),
        ("Any topic, several tasks, virtual hardware", rest),
    ):
        lines += [f"## {heading}", ""]
        for name in names:
            lines += _entry(name, inspect.getattr_static(Operator, name))
    lines += [
        "## One of several tasks: `operator.task(NAME)`", "",
        inspect.cleandoc(TaskClient.__doc__ or ""), "",
        "It has all of *Motion*, and " + ", ".join(
            f"`{n}`" for n, _ in _public(TaskClient) if n not in motions
        ) + ".", "",
    ]  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    """Bring the page up to date."""
    PAGE.write_text(page(), encoding="utf-8")


def _public(of: type) -> Iterator[tuple[str, Any]]:
    return ((n, m) for n, m in inspect.getmembers(of) if not n.startswith("_") and m is not None)


def _entry(name: str, member: Any) -> Iterator[str]:
    function: Any = member.fget if isinstance(member, property) else member
    yield f"### `{name}{'' if isinstance(member, property) else _parameters(function)}`"
    yield ""
    yield inspect.cleandoc(function.__doc__ or "")
    yield ""


def _parameters(function: Callable[..., Any]) -> str:
    """Return the parameters without `self`, in one line, types without their modules."""
    signature = inspect.signature(function)
    given = list(signature.parameters.values())[1:]
    short = signature.replace(parameters=given, return_annotation=inspect.Signature.empty)
    return re.sub(r"\b(?:[a-z_]+\.)+(?=[A-Za-z])", "", str(short))


if __name__ == "__main__":
    main()
