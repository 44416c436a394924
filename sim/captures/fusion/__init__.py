"""Fusion of RGB-D streams into surfaces that provide reference depth for their frames."""
