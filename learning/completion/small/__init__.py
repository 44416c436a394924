"""A compact network that completes depth at camera rate, and learns from nothing in minutes."""
