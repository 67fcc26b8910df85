"""`telerobot tunnel` prints what its script tells, and goes round what the daemon knows of."""

import json
import tomllib
from pathlib import Path

from telerobot import SimulatedOperator, load_cell
from telerobot.config import load
from telerobot.protocols import topics as t
from telerobot.protocols.codec import encode
from telerobot.protocols.messages.perception import ObstacleNews
from telerobot.server.events import Events
from telerobot.server.perception.free_space import find_tunnel
from telerobot.server.perception.obstacle_map import ObstacleMap
from telerobot.tools.cli import main
from telerobot.tools.commands.tunnel import find_and_tell
from telerobot.tools.identify.cli import subject_of

TO = ["--to", "0.05", "1.3", "0"]
SCRIPT = Path(load.__file__).parent / "scripts" / "between_boxes.toml"


def test_it_prints_the_step_of_the_script_that_is_shipped(capsys):
    assert main(["tunnel", "snake_boxes", *TO]) == 0
    told = tomllib.loads(capsys.readouterr().out)
    shipped = next(
        step for step in tomllib.loads(SCRIPT.read_text())["step"] if "operator/tunnel" in step
    )
    assert told["step"]["operator/tunnel"] == shipped["operator/tunnel"]


def test_as_json_it_tells_room_and_clearance(capsys):
    assert main(["tunnel", "snake_boxes", *TO, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["narrowest"] > 0.03
    assert found["clearance"] > 0.02


def test_where_none_fits_it_ends_with_1_and_says_why(capsys):
    assert main(["tunnel", "snake_boxes", "--to", "0.25", "0.97", "0"]) == 1
    assert "telerobot: no tunnel: it lies in 'second_right'" in capsys.readouterr().err


def test_told_to_the_daemon_it_goes_round_an_obstacle_that_only_the_daemon_knows_of():
    cell, to = load_cell("snake_boxes"), (0.05, 1.3, 0.0)
    with SimulatedOperator(cell) as operator:
        tick = operator.wait_state().tick
        block = ObstacleNews(
            name="block", tick=tick, shape="box", xyz=(0.07, 0.865, 0.0),
            half_size=(0.02, 0.01, 0.05), max_speed=0.0,
        )  # fmt: skip
        operator.session.put(t.OBSTACLE.by("tracker"), encode(block))
        operator.spin(0.1)
        found = find_and_tell(operator, cell, subject_of(cell, None), to)
        told = operator.spin(1.0, lambda: operator.state.tunnel is not None)
    assert told
    assert operator.state.tunnel == found.pieces
    alone = ObstacleMap.from_cell(cell, Events()).scene(0)
    assert found.pieces != find_tunnel(cell, to, alone).pieces
