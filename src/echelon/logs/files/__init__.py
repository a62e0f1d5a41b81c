"""Files of logs: CSV, Parquet, NPZ, MAT, ROS 2 bags and MCAP as tables of named columns."""
