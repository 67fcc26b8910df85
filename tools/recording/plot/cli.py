"""`telerobot plot RUN.mcap`: draws a recorded run as PNG or SVG."""

import argparse

from ....config.errors import ConfigError

STILLS = "stills"  # moments of the scene, below the panels
TUNNEL, CONTOUR = "tunnel", "contour"
"""Figures of their own: an arm in its tunnels, and one on wheels before a bridge."""


def run(args: argparse.Namespace) -> int:
    """Draw; return 0. Raises `ConfigError` for arguments or files that are wrong."""
    try:
        from .figure import PANELS, compared, drawn, load_recording
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("matplotlib", "mpl_toolkits"):
            raise
        from ....drivers.device import DeviceError

        raise DeviceError("nothing to draw with: pip install 'telerobot[plot]'") from None
    panels = tuple(args.panels.split(","))
    known = (*PANELS, STILLS)
    unknown = [name for name in panels if name not in known]
    if unknown and panels not in ((TUNNEL,), (CONTOUR,)):
        raise ConfigError(f"--panels: value '{unknown[0]}': one of {', '.join(known)}")
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
