"""Report of an identification: for people, for programs, for the cell file."""

import math
from collections.abc import Iterable

from ...config.load import Cell
from .estimate import Estimate


def as_dict(cell: Cell, found: Estimate) -> dict[str, object]:
    """Return the estimate as JSON's types."""
    return {
        "cell": cell.config.name,
        "mass": found.mass,
        "com": found.com.tolist(),
        "bias": found.bias.tolist(),
        "mounting_rpy": list(found.rpy()),
        "mounting_known": found.mounting_known,
        "calibration": None if found.calibration is None else found.calibration.tolist(),
        "residual_force": found.residual.force,
        "residual_moment": found.residual.moment,
        "rigid_residual_force": found.rigid_residual.force,
        "rigid_residual_moment": found.rigid_residual.moment,
        "condition": found.condition,
        "attitudes": found.attitudes,
        "toml": snippet(cell, found),
    }


def table(found: Estimate) -> str:
    """Return the estimate, a line each."""
    degrees = [math.degrees(a) for a in found.rpy()]
    mounting = f"rpy {_numbers(degrees, 2)} deg"
    if not found.mounting_known:
        mounting += ", the cell's own: the payload is too light to tell"
    corrected = "needed" if found.calibration is not None else "not needed"
    return "\n".join(
        (
            f"mass            {found.mass:.4f} kg",
            f"centre of mass  {_numbers(found.com, 4)} m, in the Sensor frame",
            f"bias            {_numbers(found.bias, 3)} N, N·m",
            f"mounting        {mounting}",
            f"cross-talk      correction {corrected}",
            f"residual        {found.residual.force:.3f} N, {found.residual.moment:.4f} N·m "
            f"(without correction {found.rigid_residual.force:.3f} N, "
            f"{found.rigid_residual.moment:.4f} N·m)",
            f"condition       {found.condition:.2f} from {found.attitudes} attitudes",
        )
    )


def snippet(cell: Cell, found: Estimate) -> str:
    """Return the lines of `[mechanism.force_torque]` that say what was found.

    Of one of several they are for its own table in `[[mechanisms]]`.
    """
    sensor = cell.config.mechanism.force_torque
    xyz = (0.0, 0.0, 0.0) if sensor is None else sensor.T_wrist_sensor.xyz
    lines = [
        f"[{cell.place.split('[')[0]}.force_torque]",
        f"T_wrist_sensor = {{ xyz = {_numbers(xyz, 6)}, rpy = {_numbers(found.rpy(), 6)} }}",
        f"payload = {{ mass = {found.mass:.5g}, com = {_numbers(found.com, 5)} }}",
        f"bias = {_numbers(found.bias, 4)}",
    ]
    if found.calibration is not None:
        rows = ",\n".join(f"  {_numbers(row, 6)}" for row in found.calibration)
        lines.append(f"calibration = [\n{rows},\n]")
    return "\n".join(lines)


def _numbers(values: Iterable[float], digits: int) -> str:
    numbers = [float(v) for v in values]
    return "[" + ", ".join(f"{round(v, digits) + 0.0:.{digits}f}" for v in numbers) + "]"
