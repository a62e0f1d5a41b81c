"""Files of trajectories: coefficients as JSON, samples as tables, and messages of ROS 2."""
