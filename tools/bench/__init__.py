"""How fast the control computation is, measured."""
