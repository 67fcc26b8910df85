"""An independent judge: kinematics, shapes and searches that share no code with the server's."""
