"""A second camera model, independent of the simulator and written from the effect pages alone."""
