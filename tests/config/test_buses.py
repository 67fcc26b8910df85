"""Several buses, who is on which, and tables that stand for several joints."""

import pytest
from telerobot.config.load import ConfigError, load_cell
from telerobot.tools.cli import main

BUSES = """[[buses]]
name = "left"
channel = "239.74.163.30"

[[buses]]
name = "right"
channel = "239.74.163.31"

[timing]"""


@pytest.fixture
def two(small):
    """A cell of three joints, a sensor and two buses; nothing says yet who is on which."""
    small.replace("[timing]", BUSES)
    return small


def on(bus, joint):
    return f'joint = "{joint}"', f'joint = "{joint}"\nbus = "{bus}"'


def devices(path):
    return {entry.name: entry.bus for entry in load_cell(path).devices}


def refusal(small):
    with pytest.raises(ConfigError) as caught:
        load_cell(small.cell)
    text = str(caught.value)
    assert all(line.startswith("/") for line in text.splitlines()), "a line each, of a file"
    assert text.startswith(f"{small.cell}: ")
    return text


def test_who_names_no_bus_is_on_the_first(two):
    two.replace(*on("right", "j3"))
    expected = {"j1": "left", "j2": "left", "j3": "right", "force_torque": "left"}
    assert devices(two.cell) == expected


def test_a_cell_with_one_bus_names_none(small):
    assert set(devices(small.cell).values()) == {"bus"}


def test_ids_are_unique_on_a_bus_and_free_on_another(two):
    two.replace("node = 3", 'node = 1\nbus = "right"')
    assert devices(two.cell)["j3"] == "right"
    two.replace('node = 1\nbus = "right"', 'node = 1\nbus = "left"')
    assert "mechanism.drives[2].node: value 1: already the node of the drive of 'j1'" in refusal(
        two
    )


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (*on("rihgt", "j2"), "drives[1].bus: value 'rihgt': no such bus in [[buses]]; did"),
        ('name = "right"', 'name = "left"', "buses[1].name: value 'left': is there already"),
        ("163.31", "163.30", "buses[1].channel: value '239.74.163.30:43210': already that of bus"),
        ("[[buses]]", "[bus]\nbitrate = 500000\n[[buses]]", "buses: there is a [bus], too: give"),
        ("rate_hz = 200", 'bus = "right"', "force_torque.bus: value 'right': no drive is on that"),
        ("rate_hz = 200", "command_id = 0x181", "command_id: value 0x181: is already the CAN id"),
    ],
)
def test_what_does_not_fit_is_one_line_and_exit_2(two, capsys, old, new, words):
    two.cell.write_text(two.cell.read_text().replace(old, new, 1))
    assert words in refusal(two)
    assert main(["check", str(two.cell)]) == 2
    assert words in capsys.readouterr().err


def test_an_id_of_the_sensor_is_free_where_its_owner_is_on_another_bus(two):
    two.replace(*on("right", "j1"))
    two.replace("rate_hz = 200", "command_id = 0x181")
    assert devices(two.cell)["force_torque"] == "left"


def test_what_extends_a_cell_may_put_it_on_other_buses(two, tmp_path):
    one = tmp_path / "one.toml"
    one.write_text(f'extends = "{two.cell.name}"\n[bus]\nchannel = "239.74.163.40"\n')
    assert [bus.name for bus in load_cell(one).config.fieldbuses] == ["bus"]
    back = tmp_path / "back.toml"
    back.write_text('extends = "one.toml"\n[[buses]]\nname = "middle"\n')
    assert [bus.name for bus in load_cell(back).config.fieldbuses] == ["middle"]


# --- a table for several joints ---------------------------------------------------------------


@pytest.fixture
def ranged(small):
    """The same arm with one table for its second and third joint."""
    text = small.cell.read_text()
    first = text.index("[[mechanism.drives]]", text.index('joint = "j1"'))
    second = text.index("[[mechanism.drives]]", first + 1)
    kept = text[:second] + text[text.index("[mechanism.force_torque]") :]
    small.cell.write_text(kept.replace('joint = "j2"', 'joint = "j2..j3"'))
    return small


def test_a_range_stands_for_drives_of_consecutive_nodes(small, ranged):
    drives = load_cell(ranged.cell).config.mechanism.drives
    assert [(d.joint, d.node) for d in drives] == [("j1", 1), ("j2", 2), ("j3", 3)]
    assert drives[1].model_copy(update={"joint": "j3", "node": 3}) == drives[2]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("j2..j3", "j3..j2", "drives[1].joint: value 'j3..j2': a range counts up by at most 64"),
        ("j2..j3", "j2..k3", "drives[1].joint: value 'j2..k3': a range counts up"),
        ("j2..j3", "j2..tip", "drives[1].joint: value 'j2..tip': a range counts up"),
        ("j2..j3", "j2..j99999999999", "drives[1].joint: value 'j2..j99999999999': a range"),
        ("j2..j3", "j2..j4", "drives[1].joint: value 'j4': no such movable joint"),
        ("j2..j3", "j1..j3", "drives[1].joint: value 'j1': already has a drive"),
        ("j2..j3", "j2...j3", "drives[1].joint: value 'j2...j3'"),
        ("node = 2", "node = 126", "drives[1].node: value 126: joints j2..j3 need nodes up to 127"),
        ("node = 2", "node = 1", "drives[1].node: value 1: already the node of the drive of 'j1'"),
        ("j2..j3", "j2..j65", "drives: 65 joints, at most 64"),
    ],
)
def test_a_range_that_does_not_fit_is_named_by_its_table(ranged, old, new, words):
    ranged.replace(old, new)
    assert words in refusal(ranged)
