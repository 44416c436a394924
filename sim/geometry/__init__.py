"""Coordinate frames, pinhole cameras, poses and motion."""
