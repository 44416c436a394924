"""Stereo matching and post-processing: from an infrared pair to depth."""
