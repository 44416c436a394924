"""Post-processing filters of a depth camera's software."""
