"""What the page plots of a cell's states: which charts there are, and the rows they are made of."""

from pathlib import Path

import pytest
from telerobot.config.load import shipped
from telerobot.config.schema.sources import SOURCES

STATIC = Path(__file__).resolve().parents[4] / "tools/operator/web/static"

ROWS = """
    const { chartsOf, createSeries } = await load("plots/series.js");
    const charts = chartsOf(given.description);
    const series = createSeries(charts);
    const taken = given.states.map((state) => series.add(state));
    return {
        taken,
        times: series.times,
        rows: Object.fromEntries(charts.map(({ title }, i) => [title, series.data(i).slice(1)])),
    };
"""


def told(tick, **more):
    state = {
        "tick": tick, "time_s": 0.05 * tick, "q": [0.0] * 7, "overruns": 0, "sources": {},
        "gaps": [], "wrench_mrf": None, "tasks": {},
    }  # fmt: skip
    return {**state, **more}


@pytest.mark.parametrize(
    ("cell", "titles"),
    [
        ("snake", {"Force", "Moment", "Joints in their range", "Twist by source", "Period"}),
        ("ur5e", {"Force", "Moment", "Joints in their range", "Twist by source", "Period"}),
        ("pa10_scene", {"Force", "Moment", "Joints in their range", "Nearest gaps",
                        "Twist by source", "Period"}),
        ("pa10_pair", {"Force", "Joints in their range", "Nearest gaps", "Twist by source",
                       "Period"}),
    ],
)  # fmt: skip
def test_a_cell_has_the_charts_of_what_it_has(in_node, described, cell, titles):
    given = {"description": described(cell), "states": []}
    assert set(in_node(ROWS, given)["rows"]) == titles


def test_wheels_have_no_range_to_be_in(in_node, described):
    q = [1e5, -1e5, *(0.0,) * 7]
    given = {"description": described("rover"), "states": [told(0, q=q)]}
    rows = in_node(ROWS, given)["rows"]["Joints in their range"]
    assert len(rows) == 7
    assert all(-100.0 < row[0] < 100.0 for row in rows)


def test_rows_hold_what_states_tell_and_nothing_where_they_tell_nothing(in_node, described):
    description = described("pa10_scene")
    joints = description["joints"]
    q = [joint["upper"] for joint in joints]
    name = description["obstacles"][0]["name"]
    gaps = [["link7", name, 0.04, True], ["link7", "link1", 0.2, False]]
    states = [
        told(0, wrench_mrf=[1.0, 2.0, 3.0, 0.0, 0.0, 0.5], q=q),
        told(1, gaps=gaps, sources={"joystick": [0.03, 0.0, 0.04, 0.0, 0.0, 0.0]}),
        told(2, overruns=2, q=[None] * 7),
    ]
    rows = in_node(ROWS, {"description": description, "states": states})["rows"]
    assert rows["Force"] == [[1.0, None, None], [2.0, None, None], [3.0, None, None]]
    assert [row[0] for row in rows["Joints in their range"]] == pytest.approx([100.0] * 7)
    assert rows["Joints in their range"][0][2] is None
    assert rows["Nearest gaps"] == [[None, 40.0, None], [None, 200.0, None]]
    assert rows["Twist by source"][0][1] == pytest.approx(50.0)
    assert rows["Period"][0][1:] == pytest.approx([50.0, 50.0])
    assert rows["Period"][1][1:] == [0.0, 2.0]


def test_rows_are_forgotten_after_their_time_and_with_a_daemon_that_starts_anew(in_node, described):
    description = described("pa10")
    long = [told(tick) for tick in range(1000)]
    times = in_node(ROWS, {"description": description, "states": long})["times"]
    assert 30.0 <= times[-1] - times[0] < 35.0
    again = [*long[:40], told(0), told(1), told(1.2)]
    result = in_node(ROWS, {"description": description, "states": again})
    assert (result["times"], result["taken"][-3:]) == ([0.0, 0.05], [True, True, False])


def test_every_shipped_cell_can_be_plotted(in_node, described):
    cells = [described(name) for name in shipped("cells")]
    given = [
        {"description": cell, "states": [told(1, q=[0.1] * len(cell["joints"]))]} for cell in cells
    ]
    program = f"return Promise.all(given.map(async (given) => {{ {ROWS} }}));"
    for result in in_node(program, given):
        assert all(len(row) == 1 for chart in result["rows"].values() for row in chart)


def test_the_error_in_the_picture_is_drawn_of_each_task_that_a_camera_may_lead(in_node, described):
    description = described("pa10_nodes")
    names = [task["name"] for task in description["tasks"]]
    tasks = {name: {"view_error_px": float(i)} for i, name in enumerate(names) if i}
    given = {"description": description, "states": [told(1, view_error_px=7.5, tasks=tasks)]}
    rows = in_node(ROWS, given)["rows"]["Off the stored picture"]
    seen = {camera["task"] for camera in description["cameras"]} | {"beam"}
    assert rows == [[float(i) if i else 7.5] for i, name in enumerate(names) if name in seen]
    charts = in_node(ROWS, {"description": described("pa10"), "states": []})["rows"]
    assert "Off the stored picture" not in charts


def test_names_reach_the_page_as_text_only():
    modules = [*(STATIC / "scene").rglob("*.js"), *(STATIC / "plots").rglob("*.js")]
    assert len(modules) > 10
    for module in modules:
        for markup in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write"):
            assert markup not in module.read_text(), module.name


def test_every_source_of_the_server_has_its_line(in_node, described):
    charts = """
        const { chartsOf } = await load("plots/series.js");
        const chart = chartsOf(given.description).find(({ title }) => title === "Twist by source");
        return chart.series.map(({ name }) => name);
    """
    assert in_node(charts, {"description": described("ur5e")}) == [*SOURCES, "frames"]
