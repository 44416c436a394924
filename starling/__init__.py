"""Physically based active-stereo depth cameras, simulated from the light up."""
