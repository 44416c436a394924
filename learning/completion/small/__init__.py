"""A compact network that completes depth at camera rate and trains from scratch in minutes."""
