"""A judge that learns to tell simulated captures from real ones."""
