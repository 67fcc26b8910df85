"""The part `fuzz`: inputs that nobody sends on purpose, drawn from seeds."""
