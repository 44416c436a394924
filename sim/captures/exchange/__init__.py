"""Import and export of captures in the layouts of other programs."""
