"""`telerobot check --picture`: shapes of links and the capsules that stand for them."""

import json
import math
import re
import struct

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.tools.cli import main

pytest.importorskip("matplotlib", reason="pip install 'telerobot[plot]'")


@pytest.fixture
def cell(odd, tmp_path):
    out = tmp_path / "odd.toml"
    assert main(["init", str(odd.write()), "--out", str(out)]) == 0
    return out


def shapes(capsys, *args):
    """Return what `check` says of each link's shape, by link."""
    assert main(["check", *map(str, args), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["findings"]
    of = "shape of "
    return {f["check"].removeprefix(of): f for f in found if f["check"].startswith(of)}


def test_the_picture_shows_every_link_and_states_how_tight_its_capsules_are(cell, capsys, tmp_path):
    from telerobot.tools.recording.plot.scenes import covers, drawn

    capsys.readouterr()
    out = tmp_path / "shapes.png"
    told = shapes(capsys, cell, "--picture", out)
    assert {"Base", *(f"Link_{i}" for i in range(1, 7))} <= told.keys()
    assert all(f["status"] == "ok" for f in told.values())
    links = covers(load_cell(cell), {})
    by_name = {link.link: link for link in links}
    # Link_3 is a box of 6 by 5 by 14 cm, which is its own hull.
    one = by_name["Link_3"]
    (tube,) = one.tubes
    volume = (
        math.pi * tube.radius**2 * (np.linalg.norm(tube.end - tube.start) + 4 / 3 * tube.radius)
    )
    assert told["Link_3"]["values"]["ratio"] == pytest.approx(volume / (0.06 * 0.05 * 0.14))
    assert told["Link_3"]["text"] == f"1 capsule, {one.ratio:.2f} × its hull"
    data = out.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert min(struct.unpack(">II", data[16:24])) > 500
    figure = drawn("odd", links)
    titles = [ax.get_title() for ax in figure.axes]
    for link in links:
        assert any(title.startswith(f"{link.link}\n") for title in titles)
        assert any(title.startswith(link.text()) for title in titles)


def test_a_shape_that_stands_out_of_its_capsules_is_told(cell, capsys, tmp_path):
    text = cell.read_text()
    at = text.index('link = "Link_3"\nstart')
    radius = float(re.search(r"radius = ([\d.e-]+)", text[at:])[1])
    cell.write_text(
        text[:at] + re.sub("radius = .*", f"radius = {radius - 0.004}", text[at:], count=1)
    )
    capsys.readouterr()
    told = shapes(capsys, cell, "--picture", tmp_path / "shapes.png")["Link_3"]
    assert told["status"] == "warn"
    assert told["values"]["outside"] == pytest.approx(0.004, abs=4e-4)
    assert "stands out" in told["text"]


def test_a_picture_needs_its_meshes_and_a_file_name(cell, odd, capsys, tmp_path):
    assert main(["check", str(cell), "--picture", str(tmp_path / "shapes.jpg")]) == 2
    assert "must end in .png or .svg" in capsys.readouterr().err
    (odd.folder / "meshes").rename(tmp_path / "elsewhere")
    out = str(tmp_path / "shapes.svg")
    assert main(["check", str(cell), "--picture", out]) == 2
    assert "link 'Link_1': <collision>: <mesh filename>" in capsys.readouterr().err
    (tmp_path / "moved").mkdir()
    (tmp_path / "elsewhere").rename(tmp_path / "moved" / "meshes")
    package = f"odd_description={tmp_path / 'moved'}"
    assert main(["check", str(cell), "--picture", out, "--package", package]) == 0
