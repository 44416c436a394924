"""What depth and holes alone tell, where there is no infrared."""
