"""Part `tunnel`: snakes in random tunnels, planar and in space."""
