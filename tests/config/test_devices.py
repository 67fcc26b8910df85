"""Devices of a cell: their names, buses and places in the file, mechanism by mechanism."""

import pytest
from telerobot.config.load import ConfigError, load_cell
from telerobot.drivers.bus import Hub, InProcessBus
from telerobot.drivers.fieldbus import Fieldbus, Fieldbuses
from telerobot.drivers.kinds import make_drivers

PAIR = """
name = "two"
default_script = "pa10_tour"
[[buses]]
name = "one"
channel = "239.74.163.30"
[[buses]]
name = "other"
channel = "239.74.163.31"
[enabling_switch]
node = 30
bus = "other"
[[mechanisms]]
name = "left"
like = "pa10_hand"
bus = "one"
T_world_base = { xyz = [0.0, 2.0, 0.0] }
gripper = { node = 20 }
[[mechanisms]]
name = "right"
like = "ur5e"
bus = "other"
T_world_base = { xyz = [0.0, -2.0, 0.0] }
gripper = { node = 20 }
"""


def test_devices_come_in_the_order_of_booting_with_names_that_are_unique(cell):
    two = cell(PAIR)
    names = [entry.name for entry in two.devices]
    joints = list(two.joints)
    assert names == [
        *joints[:7], "left.force_torque", "left.gripper", *joints[7:], "right.force_torque",
        "right.gripper", "enabling_switch",
    ]  # fmt: skip
    assert [entry.part for entry in two.devices] == [0] * 9 + [1] * 8 + [None]
    assert [entry.bus for entry in two.devices] == ["one"] * 9 + ["other"] * 9
    keys = {entry.name: entry.key for entry in two.devices}
    assert keys["left.s2"] == "mechanisms[0].drives[1]"
    assert keys[joints[9]] == "mechanisms[1].drives[2]"
    assert keys["right.gripper"] == "mechanisms[1].gripper"
    assert keys["enabling_switch"] == "enabling_switch"


def test_the_devices_of_a_single_mechanism_keep_their_short_names():
    entries = {entry.name: entry for entry in load_cell("pa10_hand").devices}
    assert {"s1", "force_torque"} <= set(entries)
    assert entries["s2"].key == "mechanism.drives[1]"
    assert {entry.part for entry in entries.values()} == {0}


def test_drivers_bear_the_names_of_devices_and_know_their_mechanisms(cell):
    two, hubs = cell(PAIR), (Hub(), Hub())
    buses = [Fieldbus(InProcessBus(hub), lambda: 0.0, f"bus {i}") for i, hub in enumerate(hubs)]
    drivers = make_drivers(two, Fieldbuses(*buses))
    assert [d.name for d in drivers] == [entry.name for entry in two.devices]
    assert [d.part for d in drivers] == [entry.part for entry in two.devices]
    assert [d.bus for d in drivers] == ["bus 0"] * 9 + ["bus 1"] * 9


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('bus = "other"\nT_', 'bus = "othr"\nT_', "mechanisms[1].bus: value 'othr': no such bus"),
        (
            'bus = "other"\nT_', 'bus = "one"\nT_',
            "mechanisms[1].drives[0].node: value 1: already the node of the drive of 'left.s1'",
        ),
        ("node = 30", "node = 3", "enabling_switch.node: value 3: already the node of the drive"),
        (
            "gripper = { node = 20 }\n[[", "gripper = { node = 3 }\n[[",
            "mechanisms[0].gripper.node: value 3: already the node of the drive of 'left.s3'",
        ),
        (
            "node = 30", "node = 20",
            "enabling_switch.node: value 20: already the node of the gripper of 'right'",
        ),
        ("node = 20 }\n[[", "node = 20, bus = 'on' }\n[[", "mechanisms[0].gripper.bus: value 'on'"),
    ],
)  # fmt: skip
def test_ids_are_unique_on_a_bus_whoever_the_devices_belong_to(cell, old, new, words):
    assert old in PAIR
    with pytest.raises(ConfigError) as caught:
        cell(PAIR.replace(old, new, 1))
    assert words in str(caught.value)
    assert all(line.startswith("/") for line in str(caught.value).splitlines()), "a file, a line"
