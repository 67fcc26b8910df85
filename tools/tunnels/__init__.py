"""Tunnels for hyper-redundant arms: found as the free space between obstacles."""
