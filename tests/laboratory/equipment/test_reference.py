import pytest
from laboratory.equipment.reference import BEGIN, END, PAGE, reference, updated
from telerobot.config.schema.cell import CellConfig
from telerobot.config.schema.mechanism import DriveSection


def test_the_page_shows_the_schema_as_it_is():
    text = PAGE.read_text(encoding="utf-8")
    assert updated(text) == text, "run: python -m laboratory.equipment.reference"


def test_every_section_and_key_is_there():
    page = reference()
    for key in (*CellConfig.model_fields, *DriveSection.model_fields):
        assert f"| `{key}` |" in page
    assert "## `[[mechanism.drives]]`" in page
    assert "## `[mechanism.force_torque.payload]`" in page


def test_bounds_defaults_and_meaning_stand_in_the_row():
    assert "| `period_s` | number, ≥ 0.001, ≤ 0.1 | `0.01` | control and SYNC period T [s] |" in (
        reference()
    )
    assert "| `node` | integer, ≥ 1, ≤ 127 | **required** |" in reference()


def test_what_stands_around_the_markers_is_kept():
    page = updated(f"before\n{BEGIN}\nstale text\n{END}\nafter\n")
    assert page.startswith(f"before\n{BEGIN}\n")
    assert page.endswith(f"{END}\nafter\n")
    assert "stale text" not in page


def test_a_page_without_markers_is_refused():
    with pytest.raises(ValueError, match="needs the lines"):
        updated("no markers")
