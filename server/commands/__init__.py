"""Commands of operators: streams, goals, settings, redefined frames, the master's clutch."""
