"""A hyper-redundant arm: a curve first, and joints that fit it (Chirikjian & Burdick 1990)."""
