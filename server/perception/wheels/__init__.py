"""Where a base on wheels is: odometry, corrected by news."""
