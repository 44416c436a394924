"""Published networks for comparison, scaled to metres by the sensor's depth."""
