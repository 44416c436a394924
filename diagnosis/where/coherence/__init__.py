"""Coherence split: which part of the unexplained image lies on surfaces, and which is noise."""
