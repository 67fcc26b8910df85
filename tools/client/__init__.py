"""A client of the daemon: protocol, session and the public `Operator`."""
