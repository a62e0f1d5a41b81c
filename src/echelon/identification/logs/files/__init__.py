"""Files of logs: CSV, Parquet, NPZ, MAT, HDF5, ROS bags and MCAP as tables of named columns."""
