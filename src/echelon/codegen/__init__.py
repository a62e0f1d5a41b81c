"""Source code of a robot's functions: one plan of statements, one printer and some templates for each language."""
