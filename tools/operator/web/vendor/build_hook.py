"""Hook of hatchling: no wheel is built without the JavaScript that the page is served with."""

import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class VendoredHook(BuildHookInterface[Any]):
    """Refuses a wheel whose page would be empty; an editable install may go without."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002
        """Raise `RuntimeError` where files are missing."""
        if version == "editable":
            return
        sys.path.insert(0, str(Path(__file__).resolve().parent))
        from fetch import missing  # type: ignore[import-not-found]

        if lacking := missing():
            raise RuntimeError(
                f"the console's JavaScript is not there: {', '.join(lacking)}: run `make page`"
            )
