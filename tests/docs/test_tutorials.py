"""The tutorials, worked through in the order of the page: files written, commands run."""

import re

import pytest

from .pages import Desk, clone


def numbers(text):
    return [float(x) for x in re.findall(r"-?\d+\.\d+", text)]


@pytest.mark.hil
@pytest.mark.alone
def test_drive(tmp_path):
    desk = Desk(tmp_path)
    desk.work_through("docs/tutorials/drive.md")
    moved = numbers(desk.printed.split("moved by")[1].splitlines()[0])
    assert moved == pytest.approx([0.0, 0.1, 0.02 * 2.1], abs=0.01)
    assert "mode: stopping" in desk.printed or "mode: hold" in desk.printed


@pytest.mark.hil
@pytest.mark.alone
def test_own_arm(tmp_path):
    desk = Desk(tmp_path)
    desk.work_through("docs/tutorials/own_arm.md")
    assert "CONFIRM" in desk.printed


@pytest.mark.slow
def test_own_source(tmp_path):
    desk = Desk(tmp_path, clone(tmp_path))
    desk.work_through("docs/tutorials/own_source.md")
    (height,) = numbers(desk.printed.split("height of the tool:")[1].splitlines()[0])
    assert height == pytest.approx(0.59, abs=0.001)


@pytest.mark.slow
def test_record_and_policy(tmp_path):
    desk = Desk(tmp_path)
    desk.work_through("docs/tutorials/policy.md")
    assert "postures played" in desk.printed
    (left,) = numbers(desk.printed.split("left:")[1].splitlines()[0])
    assert left < 0.005
