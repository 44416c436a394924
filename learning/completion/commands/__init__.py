"""The work behind the verbs of depth completion."""
