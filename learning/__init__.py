"""Prediction of no-depth pixels that physics misses: networks, baselines and evaluation."""
