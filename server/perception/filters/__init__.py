"""Filters of news: pure functions from a state and a measurement to the next state."""
