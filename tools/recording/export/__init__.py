"""Recorded runs as tables: arrays, parquet, and data sets to learn from."""
