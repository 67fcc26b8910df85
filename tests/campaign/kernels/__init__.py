"""Random inputs for single stages of the tick."""
