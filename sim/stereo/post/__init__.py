"""Post-processing: what a depth camera's software does to disparities before a user sees depth."""
