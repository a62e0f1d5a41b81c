"""Measured logs: reading files, what their columns mean for a robot, faults, and their preparation."""
