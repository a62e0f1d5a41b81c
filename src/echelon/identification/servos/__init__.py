"""Arms without torque sensors: models from positions and position commands."""
