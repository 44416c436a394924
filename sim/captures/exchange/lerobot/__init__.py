"""Export to the data set format of LeRobot."""
