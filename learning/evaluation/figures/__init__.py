"""How well probabilities of no-depth pixels hold: ranking, sharpness, calibration, intervals."""
