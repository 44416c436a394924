"""HTML elements shared by all reports."""
