"""Exciting trajectories: motions that make every base parameter visible, within a robot's limits."""
