"""HTML elements that all reports share."""
