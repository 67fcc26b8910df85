"""`telerobot tunnel`: find a tunnel between obstacles, and print it or tell the daemon of it."""

import argparse
import json
import math
from contextlib import suppress
from typing import Any

from ...config.load import Cell
from ...protocols import topics as t
from ...protocols.codec import CodecError, decode_as
from ...protocols.messages.perception import ObstacleNews
from ...server.control.scene import Scene
from ...server.events import Events
from ...server.perception.free_space import FoundTunnel, NoTunnelError, Place, find_tunnel
from ...server.perception.obstacle_map import ObstacleMap
from ...server.refusals import Refused
from ..client.operator import Operator, OperatorError
from ..host.address import cell_from
from ..host.progress import say
from ..identify.cli import Subject, subject_of

HEARD_S = 1.5
"""The daemon tells of an obstacle in each tick, in turn, of at most 128 [s]."""


def run(args: argparse.Namespace) -> int:
    """Find the tunnel; print it, and tell it where that is asked for. Raises `ConfigError`."""
    cell, (x, y, z) = cell_from(args), args.to
    subject = subject_of(cell, args.mechanism)
    try:
        if args.tell:
            with Operator(cell) as operator:
                found = find_and_tell(operator, cell, subject, (x, y, z))
        else:
            scene = ObstacleMap.from_cell(cell, Events()).scene(0)
            found = find_tunnel(subject.part, (x, y, z), scene)
    except NoTunnelError as error:
        say(f"telerobot: no tunnel: {error}")
        return 1
    except OperatorError as error:
        say(f"telerobot: not told: {error}")
        return 1
    print(json.dumps(found._asdict()) if args.json else step(found))
    return 0


def find_and_tell(operator: Operator, cell: Cell, subject: Subject, to: Place) -> FoundTunnel:
    """Find a tunnel between the obstacles that the daemon knows of, and tell it.

    It is searched for before the lease is taken, which would not be renewed meanwhile. Raises
    `NoTunnelError` and `OperatorError`.
    """
    found = find_tunnel(subject.part, to, known_scene(operator, cell))
    operator.acquire()
    more: dict[str, Any] = {} if subject.mechanism is None else {"mechanism": subject.mechanism}
    operator.tunnel(found.pieces, **more)
    return found


def known_scene(operator: Operator, cell: Cell) -> Scene:
    """Return the obstacles of a cell, and those that its daemon was told of, where it has them."""
    inbox = operator.session.subscribe(t.HELD, t.HELD.unread)
    operator.wait_state()
    operator.spin(HEARD_S)
    known, tick = ObstacleMap.from_cell(cell, Events()), operator.wait_state().tick
    for payload in inbox.take():
        with suppress(CodecError, Refused):
            news = decode_as(ObstacleNews, payload, t.HELD.max_bytes)
            known.take(news, tick, "daemon")
    return known.scene(tick)


def step(found: FoundTunnel) -> str:
    """Return a tunnel as the step of a script, with what it keeps clear of."""
    near = "there are no obstacles"
    if math.isfinite(found.clearance):
        near = f"links come to {1e3 * found.clearance:.1f} mm of '{found.nearest}'"
        near += f"; {1e3 * found.narrowest:.1f} mm of room about its centre line"
    rows = "".join(f"  [{', '.join(f'{x:.6g}' for x in piece)}],\n" for piece in found.pieces)
    return f'# {near}\n[step."operator/tunnel"]\npieces = [\n{rows}]'
