"""Fit a sensor (geometry, projector, pattern, photometry) to captures, with uncertainty."""
