"""Real captures as scenes: estimation of surface, reflectance and light."""
