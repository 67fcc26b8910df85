"""Every exhibit of the papers is whole and on the page, and a number that moved fails."""

import re

import numpy as np
import pytest
from laboratory.papers import cli, page
from laboratory.papers.exhibit import Number, Shown, at_least, at_most, near
from laboratory.papers.exhibits import EXHIBITS, PAPERS


def test_names_are_unique_and_rows_are_whole():
    assert sum(len(paper.exhibits) for paper in PAPERS) == len(EXHIBITS)
    for name, exhibit in EXHIBITS.items():
        told = exhibit._replace(wrong="may be empty")
        assert all(told), name
        assert f"--only {name}" in exhibit.command


def test_the_committed_page_has_every_exhibit_with_its_picture_in_the_order_of_the_table():
    text = (cli.FOLDER / page.PAGE).read_text(encoding="utf-8")
    headings = re.findall(r"^### (.*)$", text, re.MULTILINE)
    assert headings == [page.heading(exhibit) for exhibit in EXHIBITS.values()]
    assert re.findall(r"\]\((\w+)\.svg\)", text) == list(EXHIBITS)
    pictures = {path.stem for path in cli.FOLDER.glob("*.svg")}
    assert pictures == set(EXHIBITS)
    for exhibit in EXHIBITS.values():
        assert exhibit.printed in text
        assert exhibit.wrong in text


def test_a_bar_in_a_number_s_name_is_no_column():
    row = page.row(near("|Pτ|", 1.0, 1.0, 0.1, "N·m"))
    assert len(re.split(r"(?<!\\)\|", row)) == 7
    text = (cli.FOLDER / page.PAGE).read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert {len(re.split(r"(?<!\\)\|", row)) for row in rows} == {7}


def test_what_rounding_leaves_is_told_by_its_power_of_ten_and_a_zero_without_sign_or_digits():
    told = [page.ours(at_most("residue", x, "0", 1e-6)) for x in (5.3e-10, 4.2e-10, 0.0, 2e-6)]
    assert told == ["< 1e-09", "< 1e-09", "0", "2e-06"]
    told = [page.ours(near("torque", x, 0.0, 5.1e-5)) for x in (-6.7e-17, 1.1e-15, -2e-6)]
    assert told == ["0", "0", "-2e-06"]
    assert page.ours(near("torque", -0.91614, -0.9161, 5.1e-5)) == "-0.9161"
    assert page.ours(at_most("off", 0.00234, "0", 0.01)) == "0.00234"


def test_an_exhibit_is_shown_and_the_page_is_left_alone(tmp_path, capsys):
    rows = tmp_path / "rows.jsonl"
    code = cli.main(["--only", "figure_4", "--out", str(tmp_path), "--rows", str(rows)])
    assert code == 0
    assert (tmp_path / "figure_4.svg").read_text(encoding="utf-8").startswith("<?xml")
    assert not (tmp_path / page.PAGE).exists()
    assert "farthest from eqs. 4 and 25" in capsys.readouterr().out
    # What was kept is taken for shown again, without being shown.
    again = ["--only", "figure_4", "--out", str(tmp_path / "again"), "--rows", str(rows)]
    assert cli.main([*again, "--resume"]) == 0
    pictures = [folder / "figure_4.svg" for folder in (tmp_path, tmp_path / "again")]
    assert pictures[0].read_bytes() == pictures[1].read_bytes()


@pytest.mark.parametrize("ours", [1.02, 0.98, np.nan])
def test_a_number_that_moves_by_more_than_its_tolerance_fails(ours, tmp_path, monkeypatch, capsys):
    def moved():
        return Shown([near("steady", 1.0, 1.0, 0.01), near("moved", ours, 1.0, 0.01)], "<svg/>")

    monkeypatch.setitem(EXHIBITS, "figure_4", EXHIBITS["figure_4"]._replace(show=moved))
    rows = str(tmp_path / "rows.jsonl")
    assert cli.main(["--only", "figure_4", "--out", str(tmp_path), "--rows", rows]) == 1
    assert "\n! moved:" in capsys.readouterr().out


def test_a_bound_holds_on_one_side_only():
    assert at_least("distance", 0.06, "at least 5 cm", 0.05, "m").kept
    assert not at_least("distance", 0.04, "at least 5 cm", 0.05, "m").kept
    assert page.allowed(at_least("distance", 0.06, "at least 5 cm", 0.05, "m")) == "≥ 0.05"
    assert Number("G", 1.0, "1", "1", 0.9, 1.1).kept
