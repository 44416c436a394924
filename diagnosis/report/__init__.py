"""Report of a diagnosis: sentences, figures for JSON, and an HTML page."""
