"""Published networks that completion is compared with, brought to metres by the sensor's depth."""
