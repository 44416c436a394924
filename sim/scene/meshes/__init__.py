"""Mesh files: their triangles, and the looks of their surfaces."""
