"""A virtual real camera: what scenes of a true device would be, with the truth known."""
