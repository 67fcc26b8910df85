"""Benchmarks of arms that follow curves."""
