"""The simulated CiA 402 servo drive: state machine, power stage and brake, loops, setpoints."""
