"""A judge that learns to separate simulated captures from real ones."""
