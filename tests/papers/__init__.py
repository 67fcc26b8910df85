"""Tables and figures of the five papers, computed again by telerobot."""
