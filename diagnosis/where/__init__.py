"""Where the gap lies: in which pipeline segment, at which pixels, fixed in which frame."""
