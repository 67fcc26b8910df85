"""Messages of what is perceived: obstacles, moving frames, contour, sightings, pictures."""
