"""Implementation of the command-line verbs of depth completion."""
