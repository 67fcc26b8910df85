"""Files that a user edits: cells, robots, devices, scripts, and the schema that holds them."""
