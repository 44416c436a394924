"""Sensor settings: frozen dataclasses, presets, edits and device controls."""
