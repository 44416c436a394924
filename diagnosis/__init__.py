"""The sim-to-real gap: where it is, which effect makes it, and how far it can be closed."""
