"""Benchmarks beside `telerobot bench`: peers, several arms, the page, a rover, a growing tick."""
