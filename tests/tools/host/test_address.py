import pytest
from telerobot.config.errors import ConfigError
from telerobot.config.load import load_cell
from telerobot.tools.cli import COMMANDS, build_parser, main
from telerobot.tools.host.address import cell_from, moved, options
from telerobot.tools.host.local_plant import private


def parse(*argv, bus=True):
    parser = build_parser([c for c in COMMANDS if c.name in ("rig", "drive")])
    return cell_from(parser.parse_args(["rig" if bus else "drive", *argv]))


def test_without_options_a_cell_is_what_its_file_says():
    assert parse("pa10") == load_cell("pa10")
    assert parse("pa10", bus=False) == load_cell("pa10")


def test_a_moved_cell_differs_in_its_addresses_only():
    cell, plain = parse("pa10", "--endpoint", "tcp/h:1", "--port", "5000"), load_cell("pa10")
    assert cell.config.zenoh.listen == "tcp/h:1"
    assert (cell.config.bus.port, cell.config.bus.channel) == (5000, plain.config.bus.channel)
    back = moved(cell, plain.config.zenoh.listen, ports=[str(plain.config.bus.port)])
    assert back == plain


@pytest.mark.parametrize("name", ["pa10", "rover_bridge"])
def test_the_options_of_a_cell_lead_to_the_same_cell(name):
    cell = private(load_cell(name))
    assert parse(*options(cell)).config == cell.config


def test_private_cells_share_nothing():
    one, other = (private(load_cell("pa10")).config for _ in range(2))
    assert one.zenoh.listen != other.zenoh.listen
    assert (one.bus.channel, one.bus.port) != (other.bus.channel, other.bus.port)


def test_private_cells_have_a_scanner_each():
    one, other = (private(load_cell("rover_bridge")).config.scanner for _ in range(2))
    assert one.address != other.address
    assert one == other.model_copy(update={"address": one.address})


@pytest.mark.parametrize(
    ("cell", "address", "words"),
    [
        ("rover_bridge", "udp/here", "--scanner: value udp/here"),
        ("pa10", "tcp/127.0.0.1:2112", "the cell has no scanner"),
    ],
)
def test_a_scanner_is_moved_to_where_one_may_be(cell, address, words):
    with pytest.raises(ConfigError, match=words):
        parse(cell, f"--scanner={address}")


def test_a_port_out_of_range_is_named():
    with pytest.raises(ConfigError, match="--port: value 70000"):
        parse("pa10", "--port", "70000")


@pytest.mark.parametrize("text", ["-1", "0", "nan", "inf", "soon"])
def test_a_duration_that_is_none_is_bad_usage(text, capsys):
    with pytest.raises(SystemExit) as end:
        main(["serve", "pa10", f"--seconds={text}"])
    assert end.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1
