"""Bodies beside the arm: payload on pads, pegs and holes, obstacles, bridge, walls of tunnels."""
