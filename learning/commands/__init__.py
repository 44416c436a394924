"""Implementation of the command-line verbs of learning."""
