"""Rendering with Mitsuba 3: from a scene to linear radiance layers."""
