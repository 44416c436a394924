"""The effect table: every named departure from an ideal camera, one row each."""
