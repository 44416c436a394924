"""Captures in the layouts of other programs, out and in."""
