"""Scripts: actions of operators over time, and their player."""
