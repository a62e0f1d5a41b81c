"""Exports of exact mechanisms with loops: MJCF, URDF and SDF files with rounded numbers, and true ranks."""
