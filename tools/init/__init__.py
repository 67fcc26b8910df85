"""`telerobot init`: a complete cell for an arm, from its URDF alone."""
