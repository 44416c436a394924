"""Public data sets that depth completion is trained and judged on, each in its own layout.

What is read is what their publishers' pages and programs say of the layout; nothing is downloaded.
"""
