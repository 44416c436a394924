"""What a sensor is made of: plain frozen settings, nothing here computes."""
