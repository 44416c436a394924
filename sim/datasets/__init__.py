"""Data sets of labelled captures; every frame is a pure function of a plan and its number."""
