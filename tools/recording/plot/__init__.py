"""`telerobot plot`: pictures of a recorded run."""
