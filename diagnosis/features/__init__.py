"""Numbers that tell of a reading how it was made; each part of the chain leaves its own."""
