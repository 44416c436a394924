"""Scene models of a diagnosis: captured observations and their simulation."""
