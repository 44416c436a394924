"""What physics misses: the no-depth-pixel residual network, its baselines and evaluation."""
