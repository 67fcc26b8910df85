"""One tick in words: what every stage did, in the order of the tick's page."""

from collections.abc import Iterator, Sequence

import numpy as np

from ....config.load import Cell
from ....server.control.bodies.body import STILL
from ....server.control.spatial import Array
from ....server.control.state import Inputs, Memory, Output
from .replay import Replayed

SMALL = 1e-12
"""Twists below this are not told [m/s, rad/s]."""


def explain(cell: Cell, tick: Replayed) -> str:
    """Return what one replayed tick looked at and decided, for every arm, as lines."""
    record = tick.record
    lines = [f"tick {record.tick}, {record.time_s:.3f} s, mode {record.mode}"]
    for i, part in enumerate(cell.parts):
        if len(cell.parts) > 1:
            lines.append(f"{part.config.mechanism.name}:")
        names = [joint.name for joint in part.robot.joints]
        output = tick.outputs[i] if tick.outputs else None
        after = tick.nexts[i] if tick.nexts else None
        lines += _arm(names, record.inputs[i], tick.before[i], output, after)
    if tick.raised is not None:
        lines.append(f"it raised          {tick.raised}")
    if tick.difference is not None:
        lines.append(f"not as recorded    {tick.difference}")
    return "\n".join(lines)


def _arm(
    joints: Sequence[str],
    inputs: Inputs,
    before: Memory,
    output: Output | None,
    after: Memory | None,
) -> Iterator[str]:
    yield _line("intent", inputs.intent.name.lower())
    yield _line("asked for", ", ".join(_asked(inputs)) or "nothing")
    yield _line("joints measured", _numbers(inputs.q_measured))
    wrench = inputs.wrench_sensor
    yield _line("sensor reads", "nothing fresh" if wrench is None else _numbers(wrench))
    if output is None or after is None:
        return
    yield _line("joints commanded", _numbers(output.q))
    yield _line("following error", _numbers(output.following_error))
    if output.wrench_mrf is not None:
        yield _line("wrench at the MRF", _numbers(output.wrench_mrf))
    yield "1 sources, 2 sum"
    for name, twist in output.twists.items():
        if float(np.abs(twist).max()) > SMALL:
            gain = output.gains.get(name)
            yield _line(f"  {name}", _numbers(twist) + ("" if gain is None else _gain(gain)))
    yield _line("  sum", _numbers(output.twist))
    if output.path is not None:
        path = output.path
        yield _line(
            "  path", f"leg {path.leg + 1} of {path.legs}, {path.part:.1%}, pace {path.pace:.3f}"
        )
    yield "3 resolve"
    yield _line("  least singular value", f"{output.sigma_min:.4g}")
    motion = output.self_motion
    if float(np.abs(motion.dq).max()) > SMALL:
        of = ", ".join(f"{name} {norm:.3g}" for name, norm in motion.norms.items() if norm > SMALL)
        yield _line("  self-motion", f"{_numbers(motion.dq)} ({of})")
    yield "4 allow"
    yield _line("  granted", f"{output.scale:.4f} of the motion asked for")
    yield _line("  limited by", ", ".join(output.limits) or "nothing")
    for gap in output.gaps[:5]:
        acts = ", its barrier acts" if gap.active else ""
        yield _line("  gap", f"{gap.link} - {gap.other}: {1e3 * gap.gap:.2f} mm{acts}")
    yield "5 limit"
    changed = after.motion.dq - before.motion.dq
    fastest = int(np.abs(changed).argmax())
    yield _line("  joint rates", _numbers(output.dq))
    yield _line("  greatest change", f"{joints[fastest]}: {changed[fastest]:+.4g} rad/s")
    took = "the stop verified before goes on" if "verified_stop" in output.limits else "a new one"
    yield _line("  verified stop", f"{took}, {after.stop.to_go_s:.3f} s long")
    if output.stop_worsened:
        yield _line("  worsened", "no stop keeps every clearance: the least bad one was taken")
    yield "6 gate, 7 actuate"
    yield _line("  refusal", output.refusal or "none")
    yield _line("  sent", _numbers(output.command))
    state = [
        word
        for word, so in (
            ("at rest", output.at_rest),
            ("at its goal", output.at_goal),
            ("bleeding off contact", output.bleeding),
        )
        if so
    ]
    yield _line("  state", ", ".join(state) or "moving")


def _asked(inputs: Inputs) -> Iterator[str]:
    """Yield what operators and devices ask for in this tick."""
    if inputs.stick is not None:
        yield f"stick {_numbers(inputs.stick.twist)}"
    if inputs.jog is not None:
        yield f"jog {_numbers(inputs.jog)}"
    if inputs.goal is not None:
        yield f"{type(inputs.goal).__name__} {inputs.goal.serial}"
    if inputs.paused:
        yield "paused"
    if inputs.posture is not None:
        yield f"posture {_numbers(inputs.posture)}"
    if inputs.view is not None:
        yield "view"
    if np.any(inputs.wrench_desired):
        yield f"wrench {_numbers(inputs.wrench_desired)}"
    if inputs.drive != STILL:
        yield f"insertion {inputs.drive}"
    if inputs.settings.speed_factor != 1.0:
        yield f"speed factor {inputs.settings.speed_factor:g}"


def _gain(gain: Array) -> str:
    return f", gain {_numbers(gain)}"


def _numbers(values: Array) -> str:
    return "[" + " ".join(f"{value:.5g}" for value in values.tolist()) + "]"


def _line(name: str, words: str) -> str:
    return f"{name:<22} {words}"
