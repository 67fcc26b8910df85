"""Schema of a mechanism: chain, drives, tool, base, backbone, sweep, and what its torques tell."""
