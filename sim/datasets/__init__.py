"""Many labelled captures from a plan: every frame a pure function of plan and index."""
