"""HOLD: contact is bled off, and what was touched is given way to."""
