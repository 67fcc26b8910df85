"""Benchmarks: control computation, SYNC, latency, simulation."""
