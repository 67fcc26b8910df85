"""What news of the contour ahead may ask of base and arm."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.protocols.messages.perception import ContourNews
from telerobot.server.events import Events
from telerobot.server.perception.ahead import Passage
from telerobot.server.refusals import Refused, Why
from telerobot.server.units.unit import LookingAhead, SweptAxis

CELL = load_cell("rover_bridge")
FOLDED = (0.5, -1.0, 0.2, -1.5, 0.1, 0.2, 0.3)


class Ahead:
    """One passage, told and asked tick by tick."""

    def __init__(self, wait: bool = True, steer: float = 0.0) -> None:
        self.events = Events()
        cell = altered(CELL, {"contour.wait": wait, "contour.steer": steer})
        self.passage = Passage.from_cell(cell, self.events)

    def tell(self, tick: int, **fields: object) -> None:
        news = {
            "tick": tick, "rows": 20, "columns": 40, "cell": 0.05,
            "nearest_mm": b"\xff\xff" * 800, "phase": "clear",
        } | fields  # fmt: skip
        self.events.at(tick, 0.01 * tick)
        self.passage.take(ContourNews.model_validate(news), tick)
        self.passage.update(tick)

    @property
    def told(self) -> list[str]:
        return [event.name for event in self.events.take()]


def test_nobody_drives_ahead_before_anything_was_seen() -> None:
    ahead = Ahead()
    assert ahead.passage.share(0.1) == 0.0
    assert ahead.passage.share(-0.1) == pytest.approx(0.5)  # backing out is slow
    ahead.tell(5)
    assert ahead.passage.share(0.1) == 1.0


def test_a_base_that_is_driven_straight_ahead_steers_and_who_turns_it_is_obeyed() -> None:
    ahead = Ahead(steer=0.8)
    assert ahead.passage.turn(0.2, 0.0) == 0.0
    ahead.tell(5, curvature=-0.5)
    assert ahead.passage.turn(0.2, 0.0) == pytest.approx(-0.1)
    assert ahead.passage.turn(0.2, 0.03) == 0.03
    assert ahead.passage.turn(-0.2, 0.0) == 0.0
    assert ahead.told == ["scanner_heard", "steers_aside", "steered_aside"]
    ahead.passage.update(60)  # silence
    assert ahead.passage.turn(0.2, 0.0) == 0.0


def test_one_way_around_is_told_once_however_often_it_goes_straight_for_a_moment() -> None:
    ahead = Ahead(steer=0.8)
    for tick in range(0, 600, 5):
        ahead.tell(tick, curvature=-0.5 if tick in (50, 60, 100, 180) else 0.0)
        for _ in range(5):
            ahead.passage.turn(0.2, 0.0)
    assert ahead.told == ["scanner_heard", "steers_aside", "steered_aside"]


@pytest.mark.parametrize(("steer", "curvature"), [(0.0, 0.01), (0.8, -0.81), (0.8, 2.0)])
def test_an_arc_that_is_closer_than_the_cell_says_is_refused(
    steer: float, curvature: float
) -> None:
    ahead = Ahead(steer=steer)
    with pytest.raises(Refused, match=f"curvature: {curvature:g}: at most {steer:g}") as refused:
        ahead.tell(5, curvature=curvature)
    assert refused.value.reason is Why.OUT_OF_RANGE
    assert ahead.passage.turn(0.2, 0.0) == 0.0


def test_back_a_base_goes_at_speed_only_over_ground_that_was_seen_and_it_is_told_once() -> None:
    ahead, creep = Ahead(), CELL.config.contour.creep
    ahead.tell(5, most_speed_back=0.2)
    assert ahead.passage.share(-0.1) == 1.0
    assert ahead.passage.share(-0.4) == pytest.approx(0.5)
    ahead.tell(6, most_speed_back=0.0)
    assert ahead.passage.share(-0.1) == pytest.approx(creep / 0.1)
    assert ahead.passage.share(-creep) == 1.0
    assert Ahead(wait=False).passage.share(-0.1) == 1.0
    ahead.told  # noqa: B018  what was told until now
    for tick, back in ((7, 0.0), (8, 1.0), (9, 0.0)):
        ahead.tell(tick, most_speed_back=back)
        ahead.passage.follow(-0.1, 0.0, tick, cleared=False)
        assert ahead.passage.held == ("unseen_behind" if back == 0.0 else "")
    assert ahead.told == ["unseen_behind"]
    ahead.passage.update(60)  # silence: nothing is known of what was seen
    assert ahead.passage.share(-0.1) == pytest.approx(creep / 0.1)
    ahead.passage.follow(0.0, 0.0, 60, cleared=False)
    assert ahead.passage.held == ""
    ahead.passage.follow(-0.1, 0.0, 61, cleared=False)
    assert ahead.told == ["scanner_silent", "unseen_behind"]


def test_a_base_slows_down_to_what_the_contour_allows() -> None:
    ahead = Ahead()
    ahead.tell(5, most_speed=0.05, phase="undecided")
    assert ahead.passage.share(0.1) == pytest.approx(0.5)
    assert ahead.passage.share(0.04) == 1.0
    assert Ahead(wait=False).passage.share(0.1) == 1.0


def test_news_that_falls_silent_stops_a_base_that_goes_ahead() -> None:
    ahead = Ahead()
    ahead.tell(5)
    ahead.passage.update(25)
    assert not ahead.passage.blind(0.1)
    ahead.passage.update(26)  # older than 0.2 s
    assert ahead.passage.blind(0.1)
    assert not ahead.passage.blind(-0.1)
    assert not ahead.passage.blind(0.0)
    assert ahead.passage.share(0.1) == 0.0
    assert ahead.told == ["scanner_heard", "scanner_silent"]
    ahead.tell(30)
    assert not ahead.passage.blind(0.1)


def test_the_posture_is_the_arms_and_ends_with_the_news() -> None:
    ahead = Ahead()
    ahead.tell(5, posture=FOLDED, phase="folding")
    posture = ahead.passage.posture(6)
    np.testing.assert_array_equal(posture[2:9], FOLDED)
    assert np.isnan(posture[[0, 1, 9]]).all()  # wheels and tilt go their own ways
    assert ahead.passage.posture(106) is None


def test_a_refusal_is_told_once_by_its_reason() -> None:
    ahead = Ahead()
    for tick in (5, 6, 7):
        ahead.tell(tick, phase="refused", reason="no_posture")
    refusals = [e for e in ahead.events.take() if e.name == "passage_refused"]
    assert [(e.values["reason"], e.detail) for e in refusals] == [
        ("no_posture", "no posture of the arm fits")
    ]


def test_clearances_that_hold_a_base_are_told_as_a_refusal_until_it_backs_out() -> None:
    ahead = Ahead()
    for tick in range(5, 500):
        ahead.tell(tick, phase="folded", posture=FOLDED, most_speed_back=0.2)
        ahead.passage.follow(0.1, 0.0, tick, cleared=True)
    refusals = [e for e in ahead.events.take() if e.name == "passage_refused"]
    assert [e.values["reason"] for e in refusals] == ["held_back"]
    assert ahead.passage.held == "held_back"
    assert ahead.passage.share(-0.1) == 1.0
    ahead.passage.follow(-0.1, 0.0, 500, cleared=True)
    assert (ahead.passage.held, ahead.told) == ("", ["passage_folded"])


@pytest.mark.parametrize(
    "fields", [{"phase": "refused", "reason": "no_posture"}, {"most_speed": 0.0}]
)
def test_a_base_that_the_reflex_stops_is_not_held_by_clearances(fields: dict[str, object]) -> None:
    ahead = Ahead()
    for tick in range(5, 1500):
        ahead.tell(tick, **({"phase": "folding"} | fields))
        ahead.passage.follow(0.1, 0.0, tick, cleared=True)
    assert ahead.passage.held == ""


def test_one_that_the_reflex_lets_wait_for_ever_is_told_of() -> None:
    ahead = Ahead()
    for tick in range(5, 3100):
        ahead.tell(tick, phase="undecided", most_speed=0.0)
        ahead.passage.follow(0.1, 0.0, tick, cleared=False)
    assert ahead.passage.held == "no_headway"


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"posture": FOLDED[:6]}, Why.WRONG_JOINTS),
        ({"posture": (0.5, -3.0, *FOLDED[2:])}, Why.OUT_OF_RANGE),
        ({"rows": 40, "columns": 20}, Why.OUT_OF_RANGE),
        ({"cell": 0.1}, Why.OUT_OF_RANGE),
    ],
)
def test_news_that_does_not_fit_the_cell_is_refused(fields: dict[str, object], why: Why) -> None:
    ahead = Ahead()
    with pytest.raises(Refused) as refused:
        ahead.tell(5, **fields)
    assert refused.value.reason is why
    assert ahead.passage.newest is None


def test_news_comes_in_turn_and_not_from_the_future() -> None:
    ahead = Ahead()
    ahead.tell(5)
    for tick, now, why in ((4, 6, Why.OUT_OF_ORDER), (9, 8, Why.FUTURE_PICTURE)):
        news = ContourNews(
            tick=tick, rows=20, columns=40, cell=0.05, nearest_mm=bytes(1600), phase="clear"
        )
        with pytest.raises(Refused) as refused:
            ahead.passage.take(news, now)
        assert refused.value.reason is why


def test_what_held_a_base_is_told_no_longer_once_it_is_not_driven() -> None:
    """In HOLD, or with the drives off, no limit acts."""
    ahead = Ahead()
    for tick in range(1, 500):
        ahead.tell(tick)
        ahead.passage.follow(0.1, 0.0, tick, cleared=True)
    assert ahead.passage.held == "held_back"
    ahead.tell(500)
    assert ahead.passage.held == "held_back"
    ahead.tell(501)
    assert ahead.passage.held == ""


def test_a_contour_has_as_many_bytes_as_cells() -> None:
    with pytest.raises(ValueError, match="1598 bytes: must be 2 for each of 20 times 40 cells"):
        ContourNews(tick=1, rows=20, columns=40, cell=0.05, nearest_mm=bytes(1598), phase="clear")


def test_the_axis_sweeps_between_its_ends_in_its_period() -> None:
    sweep = SweptAxis.from_cell(CELL)
    q, places = -1.2, []
    for _ in range(400):
        q += 0.01 * sweep.rate(q, 1.0)
        places.append(q)
    assert min(places[50:]) == pytest.approx(-1.2, abs=0.03)
    assert max(places) == pytest.approx(0.1, abs=0.03)
    np.testing.assert_allclose(places[100:190], places[303:393], atol=0.03)


def test_at_reduced_speed_it_sweeps_as_quickly_as_it_may() -> None:
    sweep, q = SweptAxis.from_cell(CELL), -1.2
    for _ in range(300):
        rate = sweep.rate(q, 0.1)
        assert abs(rate) <= 0.1 * 3.0
        q += 0.01 * rate
    assert q > -1.2 + 0.2 * 3.0


def test_cells_that_look_nowhere_have_no_reflex() -> None:
    assert LookingAhead.from_cell(load_cell("pa10")) is None
    assert Passage.from_cell(load_cell("pa10"), Events()) is None
