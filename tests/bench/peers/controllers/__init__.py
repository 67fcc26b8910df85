"""Compared controllers, each behind one contract."""
