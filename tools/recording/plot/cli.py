"""`telerobot plot RUN.mcap`: draws a recorded run as PNG or SVG."""

import argparse

from ....config.errors import ConfigError
from . import require_matplotlib

STILLS = "stills"  # moments of the scene, below the panels


def run(args: argparse.Namespace) -> int:
    """Draw; return 0. Raises `ConfigError` for arguments or files that are wrong."""
    require_matplotlib()
    from .figure import PANELS, compared, drawn, load_recording

    panels = tuple(args.panels.split(","))
    known = (*PANELS, STILLS)
    unknown = [name for name in panels if name not in known]
    if unknown:
        raise ConfigError(f"--panels: value '{unknown[0]}': one of {', '.join(known)}")
    out = args.out or args.runs[0].with_suffix(".png")
    if out.suffix not in (".png", ".svg"):
        raise ConfigError(f"--out: value '{out}': must end in .png or .svg")
    runs = [load_recording(path, args.cell) for path in args.runs]
    if len(runs) > 1:
        figure = compared(runs, args.at, args.camera)
    else:
        figure = drawn(runs[0], panels, max(1, args.stills))
    figure.savefig(out, dpi=100)
    print(out)
    return 0
