import io

from telerobot.tools.commands.rig import Refusals


def test_a_flood_of_refused_faults_is_a_line_a_second() -> None:
    now, stream = [0.0], io.StringIO()
    tell = Refusals(lambda: now[0], stream)
    for k in range(3000):
        now[0] = 0.001 * k
        tell(f"fault push: no target 'x{k}'")
    assert stream.getvalue().splitlines() == [
        "telerobot: fault refused: fault push: no target 'x0'",
        "telerobot: fault refused: fault push: no target 'x1000' (and 999 more before)",
        "telerobot: fault refused: fault push: no target 'x2000' (and 999 more before)",
    ]
