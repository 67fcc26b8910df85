"""A run as `run.parquet`, a row for each tick; events as a table of their own."""

from pathlib import Path
from typing import Any

import numpy as np

from ....config.load import ConfigError
from .table import TickTable


def arrow() -> tuple[Any, Any]:
    """Return pyarrow and its parquet. Raises `ConfigError` where they are not installed."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise ConfigError(
            "parquet and LeRobot need pyarrow: pip install 'telerobot[export]'"
        ) from None
    return pa, pq


def write_parquet(table: TickTable, folder: Path) -> None:
    """Write a table. Raises `OSError`, `ConfigError`."""
    pa, pq = arrow()
    folder.mkdir(parents=True, exist_ok=True)
    columns = {name: column(pa, values) for name, values in table.columns.items()}
    for camera, pictures in table.pictures.items():
        bytes_of = dict(pictures)
        columns[f"pictures.{camera}"] = pa.array(
            [bytes_of.get(row) for row in range(table.rows)], pa.binary()
        )
    pq.write_table(pa.table(columns), folder / "run.parquet")
    if table.events:
        pq.write_table(pa.Table.from_pylist(table.events), folder / "events.parquet")


def column(pa: Any, values: "np.ndarray[Any, Any]") -> Any:
    """Return a column (k,), or a column of lists for (k, m)."""
    if values.ndim == 1:
        return pa.array(values)
    return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
