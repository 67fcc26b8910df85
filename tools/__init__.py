"""Command line, operator's client, simulation, checks, benchmarks."""
