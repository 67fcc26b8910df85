"""Simulated devices on the bus and off it: drives, CANopen slaves, sensors, I/O modules."""
