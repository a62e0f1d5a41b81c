"""What the columns of a log mean for a robot: maps, guesses by name, units, sides of the gears."""
