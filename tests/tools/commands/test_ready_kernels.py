"""Processes that keep real time have every kernel before they begin; see `compilation`."""

import argparse

import pytest
from telerobot.config.load import load_cell
from telerobot.server import daemon
from telerobot.server.control import compilation
from telerobot.tools.commands import rig, scan


class Made(Exception):
    """All kernels were made, and nothing was opened before."""


@pytest.fixture
def told(monkeypatch):
    def made():
        raise Made

    def opened(*_, **__):
        raise AssertionError("too early")

    monkeypatch.setattr(compilation, "make_all", made)
    for module, name in ((daemon, "_join"), (rig, "open_bus"), (scan, "dial")):
        monkeypatch.setattr(module, name, opened)
    monkeypatch.setattr(rig, "until_told", lambda _seconds: None)
    monkeypatch.setattr(scan, "until_told", lambda _seconds: None)


def test_a_daemon_makes_all_kernels_before_anybody_can_speak_to_it(told):
    with pytest.raises(Made):
        daemon.serve(load_cell("pa10"))


@pytest.mark.parametrize(("command", "cell"), [(rig, "pa10"), (scan, "rover_bridge")])
def test_a_rig_and_a_scanner_make_all_kernels_before_they_open_anything(told, command, cell):
    with pytest.raises(Made):
        command.run(argparse.Namespace(cell=cell, endpoint=None, identity=None, seconds=None))
