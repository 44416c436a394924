"""The command line: flags, progress, text, output folders, records."""
