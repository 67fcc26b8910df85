"""`telerobot plot RUN.mcap`: draws a recorded run as PNG or SVG."""

import argparse
from pathlib import Path

from ....config.errors import ConfigError

PANELS = (
    "distances", "potentials", "slope", "priority", "rates", "self_motion", "arm_angle", "granted",
    "off_path", "tool_path", "internal_force", "stills",
)  # fmt: skip


TUNNEL, CONTOUR = "tunnel", "contour"
"""Figures of their own: an arm in its tunnels, and one on wheels before a bridge."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs",
        metavar="RUN.mcap",
        nargs="+",
        type=Path,
        help="what `telerobot simulate --record` wrote; several are drawn side by side: the scene, "
        "the camera's picture, the distances",
    )
    parser.add_argument(
        "--out", metavar="FILE", type=Path, help=".png or .svg; by default RUN.png beside the run"
    )
    parser.add_argument(
        "--panels",
        default=",".join(PANELS),
        help="which; all: %(default)s. 'tunnel': an arm in its tunnels, at six depths. "
        "'contour': scans, contour and reflex of a rover, at --at or when its arm folds",
    )
    parser.add_argument("--stills", type=int, default=4, help="how many moments are drawn")
    parser.add_argument(
        "--at",
        type=float,
        metavar="S",
        help="moment of a comparison, else when the first run is closest to a sight line; or of a "
        "contour, else when the arm folds [s]",
    )
    parser.add_argument("--camera", help="whose picture a comparison shows; else the first")
    parser.add_argument("--cell", help="the runs' cell, where the files do not say")


def run(args: argparse.Namespace) -> int:
    """Draw; return 0. Raises `ConfigError` for arguments or files that are wrong."""
    try:
        from .figure import compared, drawn, load_recording
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("matplotlib", "mpl_toolkits"):
            raise
        from ....drivers.device import DeviceError

        raise DeviceError("nothing to draw with: pip install 'telerobot[plot]'") from None
    panels = tuple(args.panels.split(","))
    unknown = [name for name in panels if name not in PANELS]
    if unknown and panels not in ((TUNNEL,), (CONTOUR,)):
        raise ConfigError(f"--panels: value '{unknown[0]}': one of {', '.join(PANELS)}")
    out = args.out or args.runs[0].with_suffix(".png")
    if out.suffix not in (".png", ".svg"):
        raise ConfigError(f"--out: value '{out}': must end in .png or .svg")
    runs = [load_recording(path, args.cell) for path in args.runs]
    if panels == (TUNNEL,):
        from .scenes import slithering

        figure = slithering(runs[0])
    elif panels == (CONTOUR,):
        from .scenes import ducking

        figure = ducking(runs[0], args.at)
    elif len(runs) > 1:
        figure = compared(runs, args.at, args.camera)
    else:
        figure = drawn(runs[0], panels, max(1, args.stills))
    figure.savefig(out, dpi=100)
    print(out)
    return 0
