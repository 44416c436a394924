"""Evaluation of methods on rooms that they were not trained on."""
