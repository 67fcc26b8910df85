"""Devices on CAN: one contract, a real and a simulated side that meet only on the bus."""
