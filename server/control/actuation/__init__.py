"""From a commanded motion to what the drives are sent: positions, speeds or torques."""
