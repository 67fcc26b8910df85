"""Barriers: what the sent rates must keep, one file per method, and the nearest rates that do."""
