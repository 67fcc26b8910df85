"""Which task the keys lead."""

from collections.abc import Sequence

from ....protocols.messages.telemetry import State, TaskDescription


def led(state: State | None, tasks: Sequence[TaskDescription], hand: int) -> dict[str, str]:
    """Return what names the task that the keys lead, where a cell has several `tasks`.

    That is the one at `hand`, or the joint task for which its arm holds a payload with others.
    """
    if len(tasks) < 2:
        return {}
    own = tasks[hand].task
    held = None if state is None else state.of(own).held_by
    return {"task": own if held is None else held}
