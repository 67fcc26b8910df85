"""The same random scenes for telerobot and for other libraries' collision avoidance."""
