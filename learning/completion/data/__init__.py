"""Frames for depth completion, from captures and public data sets."""
