"""The control core: pure functions of their inputs, time among them; read tick.py first."""
