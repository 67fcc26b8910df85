"""Part `fuzz`: random malformed and unusual inputs, drawn from seeds."""
