"""The daemon: loop, modes, lease, telemetry, and the control core that they surround."""
