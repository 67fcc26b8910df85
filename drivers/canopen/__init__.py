"""Drivers of CANopen devices: servo drives, I/O modules."""
