"""Daemon and virtual hardware in one process, in virtual time."""
