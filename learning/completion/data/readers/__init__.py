"""Public data sets for depth completion, each in its own layout.

The layouts are those stated on the publishers' pages and in their programs. Nothing is downloaded.
"""
