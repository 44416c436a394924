"""Real captures as scenes: surface, reflectance and light estimated from them."""
