"""Scenes that need no file."""
