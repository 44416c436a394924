"""Whether captures can be what they claim to be."""
