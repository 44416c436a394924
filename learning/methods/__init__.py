"""The ways to predict no-depth pixels, each behind `learning.method.Method`."""
