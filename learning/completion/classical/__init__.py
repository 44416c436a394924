"""Completion without learning: what a learnt method has to beat."""
