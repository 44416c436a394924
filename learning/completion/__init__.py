"""Depth completion: from an image and a camera's depth to depth everywhere, with its error."""
