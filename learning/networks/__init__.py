"""Networks, their training and their weight files."""
