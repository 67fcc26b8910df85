"""Checks beyond the schema of a cell: one file per subject, each `(cell) -> findings`."""
