"""Plausibility checks of captures before a fit."""
