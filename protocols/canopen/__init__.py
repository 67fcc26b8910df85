"""CANopen: communication, drive and input/output profiles, and the sensor's frames."""
