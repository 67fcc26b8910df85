"""The judge of tunnels accepts what the shipped snakes go through, and refuses what none can."""

import numpy as np
import pytest
from laboratory.oracle.gap import crossing, sharpest_of
from laboratory.oracle.passable import passable
from laboratory.oracle.tunnel import Tunnel
from telerobot.config.load import load_cell
from telerobot.config.schema.mechanism import SegmentSection
from telerobot.config.schema.section import PoseSection
from telerobot.server.control.backbone.insertion import Backbone


def judged(section):
    return passable(section, 0.05, 1.5, 1.04, 0.01, np.zeros(3))


@pytest.mark.parametrize("name", ["snake", "snake_space", "snake_helix"])
def test_shipped_tunnels_are_passable(name):
    assert judged(load_cell(name).config.mechanism.backbone)


def test_a_gap_is_passable_that_a_curve_of_its_length_crosses_bluntly():
    section = load_cell("snake").config.mechanism.backbone
    bend, way_out = SegmentSection(length=0.25, bend=1.5707963), SegmentSection(length=0.5)
    for length, passes in [(0.302, True), (0.300, False), (0.306, False)]:
        gap = SegmentSection(
            length=length, to=PoseSection(xyz=(-0.459, 0.789, 0), rpy=(0, 0, 3.14159))
        )
        made = section.model_copy(update={"tunnel": (bend, gap, way_out)})
        assert judged(made) is passes


def test_a_gap_s_curve_is_as_sharp_as_it_is_at_its_very_end():
    begin = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    end = np.array([[0.23432936, 0.05980341, 0.0], [0.76147772, -0.64819108, 0.0]])
    assert sharpest_of(crossing(begin, end, 0.24926, 0.004)) == pytest.approx(27.8, rel=0.03)


@pytest.mark.parametrize(
    "pieces",
    [
        [
            SegmentSection(length=0.12, bend=3.0),
            SegmentSection(length=0.8),
        ],  # too sharp for links of 50 mm
        [
            SegmentSection(length=1.0, bend=3.1),
            SegmentSection(length=1.0, bend=3.1),
        ],  # it meets itself
        [SegmentSection(length=0.6, bend=-3.0), SegmentSection(length=0.6)],  # beside the free part
        # a gap of little slack that turns back
        [
            SegmentSection(length=0.3, bend=1.5),
            SegmentSection(length=0.21, to=PoseSection(xyz=(-0.41, 0.79, 0), rpy=(0, 0, -0.2))),
            SegmentSection(length=0.5),
        ],
    ],
)
def test_tunnels_that_cannot_be_followed_are_not(pieces):
    section = load_cell("snake").config.mechanism.backbone
    bow = {"bow": 3.14159} if pieces[0].bend < 0 else {}
    assert not judged(section.model_copy(update={"tunnel": tuple(pieces), **bow}))


@pytest.mark.parametrize("name", ["snake", "snake_space", "snake_helix", "snake_gap"])
def test_its_centre_line_is_the_server_s_curve(name):
    cell = load_cell(name)
    backbone, tunnel = Backbone.from_cell(cell), Tunnel(cell.config.mechanism.backbone)
    depths = np.linspace(0.01, 0.24, 40)
    points = backbone.curve.arcs.at(depths)[0]
    assert tunnel.off_centre(points) < 1e-4
    if backbone.section.axes == "planar":
        aside = points + np.array([0.0, 0.0, 0.01])
        assert tunnel.off_centre(aside) == pytest.approx(0.01, abs=1e-4)
