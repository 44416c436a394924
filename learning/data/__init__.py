"""Training data: captured and simulated scenes, folds, torch data sets."""
