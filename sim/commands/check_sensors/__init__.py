"""Stated and simulated figures of cameras, next to each other."""
