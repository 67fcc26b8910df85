from telerobot.server.events import PER_SECOND, Events


def test_events_carry_a_running_id_the_tick_the_time_and_their_values():
    events = Events()
    events.at(7, 0.07)
    events.info("mode", "ready -> enabled", mode="enabled")
    events.error("fault", "s1", cause="emcy", code=0x7305)
    first, second = events.take()
    assert (first.id, second.id) == (1, 2)
    assert (first.tick, first.time_s, first.severity) == (7, 0.07, "info")
    assert second.values == {"cause": "emcy", "code": 0x7305}
    assert events.take() == []


def flood(events, name, seconds, severity="warning"):
    """One event a tick at 100 Hz; return what gets through."""
    taken = []
    for _ in range(round(100 * seconds)):
        events.at(events.tick + 1, events.time_s + 0.01)
        getattr(events, severity)(name, "again")
        taken += events.take()
    return taken


def test_a_flood_of_one_name_is_told_a_few_times_a_second_and_none_is_lost_count_of():
    events = Events()
    told = flood(events, "command_refused", 10.0)
    most = PER_SECOND["warning"]
    assert 9 * most <= len(told) <= 11 * most
    counted = sum(1 + e.values.get("suppressed", 0) for e in told)
    assert 1000 - 100 <= counted <= 1000
    for event in told:
        recent = [e for e in told if event.time_s - 1.0 < e.time_s <= event.time_s]
        assert len(recent) <= most + 1


def test_a_flood_of_one_name_hides_no_other():
    events = Events()
    flood(events, "command_refused", 1.0)
    events.warning("lease_expired", "ann")
    assert [e.name for e in events.take()] == ["lease_expired"]


def test_errors_are_never_held_back():
    assert len(flood(Events(), "fault", 1.0, "error")) == 100


def test_an_overlong_detail_is_cut_not_refused():
    events = Events()
    events.error("tick_raised", "x" * 5000)
    assert len(events.take()[0].detail) == 1000
