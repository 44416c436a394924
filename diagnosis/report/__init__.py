"""A diagnosis for people and programs: sentences, numbers, pictures."""
