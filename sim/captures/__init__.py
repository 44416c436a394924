"""Capture sets on disk: reading, writing, other layouts, fusion."""
