"""Driver of a CiA 402 servo drive: set-up, states, setpoints, position, standstill, stop ramp."""
