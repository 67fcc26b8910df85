"""The controllers that are compared, each behind one contract."""
