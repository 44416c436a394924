"""Features of an observation: statistics that each respond to some part of the sensor pipeline."""
