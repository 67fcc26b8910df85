"""Pages to begin your own program from: each is short, runs as it is, and is tested."""
