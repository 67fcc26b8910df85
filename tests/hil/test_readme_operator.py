"""The operators in the README and on the protocol's page, run as they stand there."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

SIMPLE = (ast.Import, ast.Assign, ast.Expr, ast.Return)
ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.hil


def program_of(page="protocols/README.md", title="An operator in 15 lines"):
    section = (ROOT / page).read_text(encoding="utf-8").split(f"## {title}\n")[1]
    return re.search(r"```python\n(.*?)```", section, re.DOTALL)[1]


def test_the_operator_of_the_protocol_moves_the_arm_as_it_says(plant, tmp_path):
    text = program_of()
    default = "tcp/127.0.0.1:7447"
    assert default in text
    program = tmp_path / "operator.py"
    program.write_text(text.replace(default, plant.cell.config.zenoh.listen))
    watcher = plant.operator("watcher")
    before = plant.truth

    with subprocess.Popen(
        [sys.executable, "-W", "error", program], stdout=subprocess.PIPE, text=True
    ) as child:
        plant.until(lambda: child.poll() is not None, 30.0, "the operator did not end")
        out = child.stdout.read()

    assert child.returncode == 0
    assert out.count("'ok': True") == 2, out
    plant.until(lambda: watcher.state.mode == "hold", 2.0)
    rise = plant.truth.pose_mrf[2] - before.pose_mrf[2]
    assert rise == pytest.approx(0.02 * 2.3, abs=0.01)
    assert plant.truth.pose_mrf[:2] == pytest.approx(before.pose_mrf[:2], abs=3e-3)
    assert watcher.state.lease_holder is None


def test_the_script_in_the_readme_moves_the_arm_as_it_says(plant, tmp_path):
    text = program_of("README.md", "From your own script")
    assert text.count('Operator("pa10")') == 1
    here = f'Operator("pa10", endpoint="{plant.cell.config.zenoh.listen}")'
    program = tmp_path / "script.py"
    program.write_text(text.replace('Operator("pa10")', here))
    watcher = plant.operator("watcher")
    before = plant.truth

    with subprocess.Popen([sys.executable, "-W", "error", program]) as child:
        plant.until(lambda: child.poll() is not None, 30.0, "the script did not end")

    assert child.returncode == 0
    plant.until(lambda: watcher.state.mode == "hold", 2.0)
    moved = [b - a for a, b in zip(before.pose_mrf[:3], plant.truth.pose_mrf[:3], strict=True)]
    assert moved == pytest.approx([0.0, 0.1, 0.02 * 2.1], abs=0.01)
    assert watcher.state.lease_holder is None


def test_the_operator_of_the_protocol_is_as_short_as_it_says():
    simple = [n for n in ast.walk(ast.parse(program_of())) if isinstance(n, SIMPLE)]
    assert len(simple) <= 15
