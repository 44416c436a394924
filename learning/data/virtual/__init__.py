"""A virtual real camera: simulated captures of a "true" device with known ground truth."""
