"""Fit image levels and noise: light, lens, electronics."""
