"""What operators asked for: streams, goals, settings, redefined frames, the master's clutch."""
