"""Light of a depth image: its surfaces warped into the right imager and the projector, no rays."""
