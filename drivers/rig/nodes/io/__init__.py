"""Simulated I/O modules (CiA 401): enabling switch, gripper."""
