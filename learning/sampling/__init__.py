"""Sampling of no-depth pixels from a probability."""
