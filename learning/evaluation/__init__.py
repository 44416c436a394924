"""Evaluation of methods on held-out rooms."""
