"""Methods that predict no-depth pixels, each a `starling.learning.method.Method`."""
