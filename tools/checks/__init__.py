"""What a schema cannot see about a cell: one file per subject, each `(cell) -> findings`."""
