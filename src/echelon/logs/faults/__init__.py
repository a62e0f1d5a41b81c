"""What is wrong with a log: faults of sensors and loggers, and magnitudes that no robot has."""
