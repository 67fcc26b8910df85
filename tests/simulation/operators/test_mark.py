"""A moment of a run is marked by its operator; nothing moves otherwise because of it."""


def test_a_mark_is_an_event_with_its_words_and_moves_nothing(play):
    run = play({"at_s": 0.2, "operator/mark": {"text": "grasp begins"}}, seconds=0.4)
    (marked,) = run.events("marked")
    assert marked.detail == "grasp begins"
    assert run.summary["refused"] == []
    assert run.summary["command_hash"] == play(seconds=0.4).summary["command_hash"]


def test_a_mark_without_the_lease_is_refused(play):
    stranger = {"at_s": 0.2, "operator": "stranger", "operator/mark": {"text": "here"}}
    run = play(stranger, seconds=0.4)
    assert run.events("marked") == []
    assert run.summary["refused"] == ["0.2 s: stranger holds no lease"]
