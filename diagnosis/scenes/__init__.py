"""Scenes under diagnosis: what is observed and what is simulated."""
