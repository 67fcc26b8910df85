"""Benchmark of a rover that looks ahead."""
