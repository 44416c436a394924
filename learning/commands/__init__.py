"""The work behind the verbs of learning."""
