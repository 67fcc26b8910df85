"""The simulated CANopen slave (CiA 301): network management, objects, SDO server, PDOs."""
