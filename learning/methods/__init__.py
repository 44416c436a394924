"""The ways to predict no-depth pixels, each behind `starling.learning.method.Method`."""
