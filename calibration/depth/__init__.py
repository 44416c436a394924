"""Calibration from depth and missing depth only, without infrared images."""
