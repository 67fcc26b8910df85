"""The operator's side: a client for programs, a terminal for people."""
