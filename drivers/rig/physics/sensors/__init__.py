"""What sensors see of the virtual world: cameras, the tags they look for, the rays of a scanner."""
