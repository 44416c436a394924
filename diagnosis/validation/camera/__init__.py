"""A second camera model, independent of the simulator."""
