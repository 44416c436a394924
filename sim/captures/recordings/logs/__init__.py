"""Files of recorded messages: ROS 1 bags, ROS 2 databases, MCAP."""
