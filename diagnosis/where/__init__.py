"""Where the gap lies: in which half of the chain, at which pixels, in whose frame."""
