"""A base on wheels: its odometry, the columns of its wheels, and joint rates of base and arm."""
