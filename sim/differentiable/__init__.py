"""Derivatives of the projected light by the rig's geometry."""
