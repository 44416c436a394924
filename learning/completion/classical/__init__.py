"""Completion without learning, the reference for learnt methods."""
