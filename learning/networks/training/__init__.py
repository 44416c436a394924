"""Training of networks: input channels, batches, and a loop that can be interrupted."""
