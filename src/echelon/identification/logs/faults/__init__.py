"""Faults of logs: sensors and loggers that fail, and magnitudes that no robot has."""
