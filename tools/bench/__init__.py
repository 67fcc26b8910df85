"""How fast it is: control computation, SYNC, latency, simulation."""
