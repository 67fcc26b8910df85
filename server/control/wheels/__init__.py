"""Two driven wheels under a base: how it rolls, its odometry, and what drives it."""
