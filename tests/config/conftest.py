"""A cell from its text."""

import pytest
from telerobot.config.load import load_cell


@pytest.fixture
def cell(tmp_path):
    """Load a cell from what its file says."""

    def load(text):
        path = tmp_path / "cell.toml"
        path.write_text(text)
        return load_cell(path)

    return load
