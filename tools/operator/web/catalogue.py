"""All that an operator may send, for the page's settings: from the one table of topics."""

import re
from typing import Any

from ....config.load import Cell
from ....config.schema.sources import SourcesSection
from ....protocols import topics as t


def catalogue(cell: Cell) -> dict[str, Any]:
    """Return each command and request with the schema of its fields, and gains' units, as JSON."""
    return {
        "cell": cell.config.name,
        "gain_units": _gain_units(),
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


def _gain_units() -> dict[str, str]:
    """Return the unit of each source's gain, as its section states it: linear, angular."""
    found = {}
    for source, field in SourcesSection.model_fields.items():
        gain = getattr(field.annotation, "model_fields", {}).get("gain")
        unit = re.search(r"\[([^\]]+)\]$", "" if gain is None else gain.description or "")
        if unit is not None:
            found[source] = unit[1]
    return found
