"""What a calibration found, as figures and as a page."""
