"""The schema of a cell file: one module per section."""
