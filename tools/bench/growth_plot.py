"""The growth of the tick's time as a picture: SVG, two panels, p50 and p99.

Whole lines are of ticks after pauses, the slower of both phases; dashed ones of ticks back to back.
"""

from typing import Final

from .figures import Figures
from .tick import TARGET_US

WIDTH, HEIGHT = 380, 280
LEFT, TOP, RIGHT, BOTTOM = 60, 40, 360, 230
"""The panel inside its margins, in pixels."""
COLOURS: Final = {"p50": "#1f6fb4", "p99": "#c8502d"}


def svg(grown: Figures) -> str:
    """Return the picture of what `growth` measured."""
    parts = []
    for i, (of, rows) in enumerate(grown.items()):
        parts.append(f'<g transform="translate({i * WIDTH} 0)">{"".join(_panel(of, rows))}</g>')
    width = WIDTH * len(grown)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{HEIGHT}" '
        f'font-family="sans-serif" font-size="12"><rect width="100%" height="100%" fill="white"/>'
        f"{''.join(parts)}</svg>\n"
    )


def _panel(of: str, rows: Figures) -> list[str]:
    counts = [int(count) for count in rows]
    paused: dict[str, list[float]] = {
        name: [max(row["free_us"][name], row["limited_us"][name]) for row in rows.values()]
        for name in COLOURS
    }
    warm: dict[str, list[float]] = {
        name: [row["back_to_back_us"][name] for row in rows.values()] for name in COLOURS
    }
    top = 100.0 * (1 + max(TARGET_US, *paused["p99"], *warm["p99"]) // 100)
    low, high = min(counts), max(counts)

    def x(count: int) -> float:
        return LEFT + (RIGHT - LEFT) * (count - low) / max(1, high - low)

    def y(us: float) -> float:
        return BOTTOM - (BOTTOM - TOP) * us / top

    parts = [
        f'<path d="M{LEFT} {TOP}V{BOTTOM}H{RIGHT}" fill="none" stroke="black"/>',
        f'<text x="{LEFT}" y="{TOP - 18}">one tick [µs] against {of}</text>',
        f'<path d="M{LEFT} {y(TARGET_US):.1f}H{RIGHT}" stroke="grey" stroke-dasharray="4"/>',
        f'<text x="{LEFT - 8}" y="{y(TARGET_US) + 4:.1f}" text-anchor="end">{TARGET_US:.0f}</text>',
        f'<text x="{LEFT - 8}" y="{TOP + 4}" text-anchor="end">{top:.0f}</text>',
        f'<text x="{LEFT - 8}" y="{BOTTOM + 4}" text-anchor="end">0</text>',
    ]
    beside = -1e9
    for count in counts:
        if x(count) - beside > 18:  # labels of small counts would lie on each other
            beside = x(count)
            parts.append(
                f'<text x="{x(count):.1f}" y="{BOTTOM + 18}" text-anchor="middle">{count}</text>'
            )
    for i, (name, colour) in enumerate(COLOURS.items()):
        for times, dashes in ((paused[name], "none"), (warm[name], "6 3")):
            pairs = zip(counts, times, strict=True)
            points = " ".join(f"{x(count):.1f},{y(us):.1f}" for count, us in pairs)
            parts.append(
                f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2" '
                f'stroke-dasharray="{dashes}"/>'
            )
        legend = f"{name}; dashed: back to back"
        parts.append(
            f'<text x="{LEFT + 12}" y="{TOP + 14 + 16 * i}" fill="{colour}">{legend}</text>'
        )
    return parts
