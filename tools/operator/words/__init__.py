"""Sentences for people: events, limits and refusals, the same in the terminal and on the page."""
