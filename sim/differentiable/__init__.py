"""Derivatives of the projected light by the geometry of the rig."""
