"""Evaluation of completed depth."""
