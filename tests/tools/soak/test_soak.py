"""`telerobot soak CELL`: hostile operators break nothing, and what they break is told."""

import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.mechanism import GripperSection, PayloadSection
from telerobot.protocols import topics as t
from telerobot.tools.cli import main
from telerobot.tools.soak import cli
from telerobot.tools.soak.segments import script


def test_a_seed_keeps_its_promises_and_is_not_played_again(tmp_path, capsys):
    rows = str(tmp_path / "rows.jsonl")
    assert main(["soak", "ur5e", "--seeds", "0", "--rows", rows]) == 0
    assert "1 runs, 9" in capsys.readouterr().out
    assert main(["soak", "ur5e", "--seeds", "0", "--rows", rows, "--resume"]) == 0
    assert "0 broke a promise" in capsys.readouterr().out


def test_a_broken_promise_is_told_with_the_command_that_repeats_it(monkeypatch, capsys):
    broken = cli.Soaked(3, 900, ["j1 velocity 2 over 1 at 3.000 s"], 0.0, "")
    monkeypatch.setattr(cli, "soaked", lambda *_: broken)
    assert main(["soak", "ur5e", "--seeds", "3"]) == 1
    again = "telerobot soak ur5e --seeds 3  # j1 velocity 2 over 1 at 3.000 s"
    assert again in capsys.readouterr().out


@pytest.mark.parametrize("name", ["pa10_two"])
def test_a_cell_of_several_arms_is_refused(name, capsys):
    assert main(["soak", name]) == 2
    assert "soak leads one arm" in capsys.readouterr().err


def test_only_payloads_of_the_cell_are_switched_to():
    own = {"bare": PayloadSection(), "cup": PayloadSection(mass=0.4)}
    gripper = GripperSection(node=120, open_payload="bare", closed_payload="cup")
    cell = altered(load_cell("pa10"), {"mechanism.payloads": own, "mechanism.gripper": gripper})
    asked = {
        step.message.fields["name"]
        for seed in range(60)
        for step in script(cell, seed).step
        if step.message and step.message.topic is t.PAYLOAD and "name" in step.message.fields
    }
    assert asked == {"bare", "cup"}
