import argparse

import pytest
from telerobot.config.errors import ConfigError
from telerobot.config.load import load_cell
from telerobot.tools.cli import main
from telerobot.tools.host.address import add_cell_arguments, cell_from, moved, options
from telerobot.tools.host.local_plant import private


def parse(*argv, bus=True):
    parser = argparse.ArgumentParser()
    add_cell_arguments(parser, bus)
    return cell_from(parser.parse_args(argv))


def test_without_options_a_cell_is_what_its_file_says():
    assert parse("pa10") == load_cell("pa10")
    assert parse("pa10", bus=False) == load_cell("pa10")


def test_a_moved_cell_differs_in_its_addresses_only():
    cell, plain = parse("pa10", "--endpoint", "tcp/h:1", "--port", "5000"), load_cell("pa10")
    assert cell.config.zenoh.listen == "tcp/h:1"
    assert (cell.config.bus.port, cell.config.bus.channel) == (5000, plain.config.bus.channel)
    back = moved(cell, plain.config.zenoh.listen, ports=[str(plain.config.bus.port)])
    assert back == plain


def test_the_options_of_a_cell_lead_to_the_same_cell():
    cell = private(load_cell("pa10"))
    assert parse(*options(cell)).config == cell.config


def test_private_cells_share_nothing():
    one, other = (private(load_cell("pa10")).config for _ in range(2))
    assert one.zenoh.listen != other.zenoh.listen
    assert (one.bus.channel, one.bus.port) != (other.bus.channel, other.bus.port)


def test_a_port_out_of_range_is_named():
    with pytest.raises(ConfigError, match="--port: value 70000"):
        parse("pa10", "--port", "70000")


@pytest.mark.parametrize("text", ["-1", "0", "nan", "inf", "soon"])
def test_a_duration_that_is_none_is_bad_usage(text, capsys):
    with pytest.raises(SystemExit) as end:
        main(["serve", "pa10", f"--seconds={text}"])
    assert end.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1
