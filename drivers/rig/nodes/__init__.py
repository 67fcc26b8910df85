"""Simulated CAN nodes: drives, force/torque sensor, gripper."""
