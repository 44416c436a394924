"""Readings served as a device of librealsense. Needs the package `pyrealsense2`."""
