"""Needs of the drives' operation mode in the cell's other sections."""

from collections.abc import Iterator

from ..schema.cell import CellConfig


def mode_disagreements(config: CellConfig) -> Iterator[str]:
    """Yield what does not fit, each in one line with its key."""
    mechanism = config.mechanism
    if mechanism.base is not None and mechanism.operation_mode == "cst":
        yield (
            "mechanism.operation_mode: value 'cst': the law takes Base to stand, but there is "
            "[mechanism.base]"
        )
    if mechanism.operation_mode == "cst":
        if config.frames.base is not None:
            yield (
                "mechanism.operation_mode: value 'cst': the law takes Base to stand, but there is "
                "[frames.base]"
            )
        for i, drive in enumerate(mechanism.drives):
            if drive.max_torque_rate is None:
                yield (
                    f"mechanism.drives[{i}].max_torque_rate: missing: drives in cst need a bound "
                    f"of joint '{drive.joint}' [N·m/s]"
                )
