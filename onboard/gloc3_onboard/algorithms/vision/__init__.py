"""Pictures into motion: features, stereo geometry and odometers, each a plain class."""
