"""Readers of URDF and SDF, the XML formats of ROS and Gazebo."""
