"""Fit the geometry of imagers and projector by differentiable rendering."""
