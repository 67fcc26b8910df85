"""Recording of a running cell: a process of its own."""
