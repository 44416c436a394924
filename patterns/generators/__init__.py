"""Generators of dot patterns."""
