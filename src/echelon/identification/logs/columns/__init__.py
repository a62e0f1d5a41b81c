"""Columns of a log as quantities of a robot: maps, guesses by name and by value, units, sides of the gears."""
