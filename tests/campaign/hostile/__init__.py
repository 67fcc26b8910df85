"""Random hostile scripts and wild operators, and their verdicts."""
