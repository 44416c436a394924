"""Optics: from the light at the lens to the image on the imager."""
