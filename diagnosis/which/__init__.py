"""Attribution of a gap to effects: simulate, fit, and score on held-out scenes."""
