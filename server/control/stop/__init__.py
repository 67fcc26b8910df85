"""Joint limits in time: jerk-limited profiles, the limiter, the verified stop."""
