"""Part `urdf`: every arm among installed robot descriptions, from its URDF to motion."""

from dataclasses import replace
from pathlib import Path
from typing import Final

from ..part import Part, Selection
from ..runs import Runs
from .collection import NEEDED, Published, published
from .pictures import write_sheet
from .trial import UrdfTrial, try_arm

FOLDER: Final = Path("out/urdf")
"""Cells stay there, to look at."""


class Trials(Runs[UrdfTrial]):
    """Summary of all arms."""

    def figures(self) -> dict[str, object]:
        """Return everything as plain values."""
        return super().figures() | {
            "arms": {
                run.name: {
                    "joints": run.joints,
                    "pose_m": run.pose_m,
                    "force_n": run.force_n,
                    "clearance_m": run.clearance_m,
                    "capsules_by_hull": run.ratio,
                    "init_s": run.init_s,
                }
                for run in self.runs
            }
        }

    def lines(self) -> list[str]:
        """Return a line for each arm, then what speaks against any."""
        rows = [
            f"{run.name:16} {run.joints} joints, pose {1e3 * run.pose_m:.2f} mm, "
            f"{f'push {run.force_n:.2f} N' if run.force_n else 'no push'}, clearance "
            f"{1e3 * run.clearance_m:.1f} mm, capsules {run.ratio:.2f} × hulls, "
            f"{run.init_s:.0f} s to motion"
            for run in self.runs
        ]
        if pictures := sorted(
            p for run in self.runs if (p := FOLDER / f"{run.name}.png").is_file()
        ):
            write_sheet(pictures, FOLDER / "sheet.png")
            rows += [f"every arm as the page draws it: {FOLDER / 'sheet.png'}"]
        return [*(rows or [f"no arms are installed: {NEEDED}"]), *super().lines()]


def play(arm: Published) -> UrdfTrial:
    """Try one arm; one that is to be refused keeps its promise by that line alone."""
    tried = try_arm(arm.name, arm.urdf, arm.tips, folder=FOLDER)
    if not arm.refused:
        return tried
    if any(arm.refused in reason for reason in tried.reasons):
        return replace(tried, reasons=[])
    return replace(tried, reasons=[*tried.reasons, f"is not refused: {arm.refused}"])


def jobs(selection: Selection) -> list[Published]:
    """Return the installed arms, or those that `--cells` names."""
    found = published()
    return [arm for arm in found if arm.name in selection.cells] or found


URDF = Part(jobs, play, Trials)
