"""A run as `run.npz`: a column each, events as JSON, pictures in folders beside it."""

import json
from pathlib import Path

import numpy as np

from .table import TickTable


def write_numpy(table: TickTable, folder: Path) -> None:
    """Write a table. Raises `OSError`."""
    folder.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(folder / "run.npz", allow_pickle=False, **table.columns)
    (folder / "events.json").write_text(json.dumps(table.events, indent=1), encoding="utf-8")
    for camera, pictures in table.pictures.items():
        (folder / camera).mkdir(exist_ok=True)
        for row, data in pictures:
            (folder / camera / f"{row:08d}.png").write_bytes(data)
