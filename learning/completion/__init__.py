"""Depth completion: dense depth and its expected error from an image and a camera's depth."""
