"""Mesh files that are refused before anything reads them."""

import pytest
from telerobot.config.errors import ConfigError
from telerobot.config.urdf.meshes import LARGEST_FILE, read_mesh


@pytest.fixture(autouse=True)
def unread(monkeypatch):
    import trimesh

    monkeypatch.setattr(trimesh, "load_scene", lambda *_a, **_k: pytest.fail("read"))


def test_a_sparse_file_of_gigabytes_is_refused(tmp_path):
    path = tmp_path / "big.stl"
    with path.open("wb") as file:
        file.truncate(6 << 30)
    with pytest.raises(ConfigError, match=f"6442450944 bytes: must be at most {LARGEST_FILE}"):
        read_mesh(path)


@pytest.mark.parametrize("name", ["bomb.zip", "bomb.3mf", "bomb.zae", "bomb.tar.gz", "bomb"])
def test_what_would_be_unpacked_is_no_mesh(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(b"x")
    with pytest.raises(ConfigError, match="no mesh: its name ends in none of"):
        read_mesh(path)
