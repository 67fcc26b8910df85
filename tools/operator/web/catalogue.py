"""All that an operator may send, for the page's settings: from the one table of topics."""

from typing import Any

from ....config.load import Cell
from ....protocols import topics as t


def catalogue(cell: Cell) -> dict[str, Any]:
    """Return each command and request with the schema of its fields, as JSON."""
    return {
        "cell": cell.config.name,
        "topics": [
            {
                "key": topic.key,
                "life": topic.life.name.lower(),
                "answered": topic.flow.asks,
                "title": (topic.message.__doc__ or "").strip().partition("\n")[0],
                "schema": topic.message.model_json_schema(),
            }
            for topic in (*t.COMMANDS, *t.REQUESTS)
        ],
    }
