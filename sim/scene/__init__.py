"""Scenes: bodies, materials, spectra, and the files they are loaded from."""
