"""Judge of postures: how far joints truly are from the posture that a script asked for last."""

from ....config.load import Cell
from ....protocols import topics as t
from ....protocols.messages.rig import RigTruth
from ...scripts.script import Script


def posture_figures(cell: Cell, script: Script, truth: RigTruth) -> dict[str, object]:
    """Return the figure for a simulation's JSON; none where the last motion is to no posture.

    The farthest joint of all arms whose last command of motion is a posture [rad].
    """
    last: dict[str, tuple[float, ...] | None] = {}
    parts = {part.config.mechanism.name: part.config.mechanism for part in cell.parts}
    for step in script.steps:
        if step.message is None or step.message.topic.flow is not t.Flow.COMMAND:
            continue
        fields = step.message.fields
        name = fields.get("mechanism") or fields.get("task") or next(iter(parts))
        asked = step.says(t.POSTURE)
        if asked is None or name not in parts:
            last[name] = None
        else:
            last[name] = asked.get("q") or parts[name].postures.get(asked["posture"])
    truths, first = {}, 0
    for name, mechanism in parts.items():
        truths[name] = truth.q[first : first + len(mechanism.drives)]
        first += len(mechanism.drives)
    errors = [
        max(abs(true - told) for true, told in zip(truths[name], q, strict=True))
        for name, q in last.items()
        if q is not None
    ]
    return {"posture_error_rad": max(errors)} if errors else {}
