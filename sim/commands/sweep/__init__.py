"""Depth noise and holes against distance, by camera parameters."""
