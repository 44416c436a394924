"""How networks learn: what they see, the batches drawn, and the loop that outlives a kill."""
