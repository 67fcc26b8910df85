"""This machine: its rights, addresses of processes, a private plant."""
