"""`telerobot tunnel`: find a tunnel between obstacles, and print it or tell the daemon of it."""

import argparse
import json
import math
from typing import Any

from ...config.load import Cell
from ...config.schema.surroundings import ObstacleSection
from ...protocols import topics as t
from ...protocols.codec import CodecError, decode
from ...protocols.messages.perception import ObstacleNews
from ..client.operator import Operator, OperatorError
from ..host.address import cell_from
from ..host.progress import say
from ..identify.cli import Subject, subject_of
from .search import FoundTunnel, NoTunnelError, Place, find_tunnel

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
            found = find_tunnel(subject.part, (x, y, z), cell.config.obstacles)
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
    found = find_tunnel(subject.part, to, known_obstacles(operator, cell))
    operator.acquire()
    more: dict[str, Any] = {} if subject.mechanism is None else {"mechanism": subject.mechanism}
    operator.tunnel(found.pieces, **more)
    return found


def known_obstacles(operator: Operator, cell: Cell) -> list[ObstacleSection | ObstacleNews]:
    """Return the obstacles of a cell, and those that its daemon was told of, where it has them."""
    inbox = operator.session.subscribe(t.HELD, t.HELD.unread)
    operator.wait_state()
    operator.spin(HEARD_S)
    known: dict[str, ObstacleSection | ObstacleNews] = {o.name: o for o in cell.config.obstacles}
    for payload in inbox.take():
        try:
            news = decode(t.HELD, payload)
        except CodecError:
            continue
        if isinstance(news, ObstacleNews):
            known[news.name] = news
    return [o for o in known.values() if not (isinstance(o, ObstacleNews) and o.remove)]


def step(found: FoundTunnel) -> str:
    """Return a tunnel as the step of a script, with what it keeps clear of."""
    near = "there are no obstacles"
    if math.isfinite(found.clearance):
        near = f"links come to {1e3 * found.clearance:.1f} mm of '{found.nearest}'"
        near += f"; {1e3 * found.narrowest:.1f} mm of room about its centre line"
    rows = "".join(f"  [{', '.join(f'{x:.6g}' for x in piece)}],\n" for piece in found.pieces)
    return f'# {near}\n[step."operator/tunnel"]\npieces = [\n{rows}]'
