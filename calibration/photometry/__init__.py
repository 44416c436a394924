"""Levels and noise: light, lens, electronics."""
