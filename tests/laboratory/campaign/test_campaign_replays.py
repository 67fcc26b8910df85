"""The campaign's recorded runs: a sample of those that `campaign --only replays` plays."""

import pytest
from laboratory.campaign.hostile.replays import replayed


@pytest.mark.parametrize(("cell", "seed"), [("ur5e", 3)])
def test_a_hostile_run_replays_to_the_last_bit(cell, seed):
    run = replayed(cell, seed)
    assert run.reasons == []
    assert run.ticks > 500
