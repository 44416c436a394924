"""Features of a pixel from reference depth, and statistics of holes."""
