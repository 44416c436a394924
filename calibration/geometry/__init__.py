"""Geometry of imagers and projector, by differentiable rendering."""
