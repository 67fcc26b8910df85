"""What sensors told: obstacles, moving frames, cameras, force/torque, contact."""
