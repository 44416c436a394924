"""Metrics of predicted probabilities: ranking, proper scores, calibration, intervals."""
