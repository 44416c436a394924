"""Least squares: solvers, elimination of local unknowns, uncertainty."""
