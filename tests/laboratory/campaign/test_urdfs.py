"""An arm that is rightly refused keeps its promise by the line that refuses it, and by no other."""

import pytest
from laboratory.campaign.urdfs import runs
from laboratory.campaign.urdfs.collection import Published
from laboratory.campaign.urdfs.trial import UrdfTrial


@pytest.mark.parametrize(
    ("refused", "told", "reasons"),
    [
        ("", [], []),
        ("", ["a.urdf: no room"], ["a.urdf: no room"]),
        ("no room", ["a.urdf: no room"], []),
        ("no room", ["a.urdf: no axes"], ["a.urdf: no axes", "is not refused: no room"]),
        ("no room", [], ["is not refused: no room"]),
    ],
)
def test_an_arm_is_refused_by_its_own_line_or_moves(monkeypatch, tmp_path, refused, told, reasons):
    monkeypatch.setattr(runs, "try_arm", lambda name, *_, **__: UrdfTrial(name, reasons=told))
    arm = Published("arm", tmp_path / "a.urdf", (), refused)
    assert runs.play(arm).reasons == reasons
