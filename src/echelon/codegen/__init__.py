"""Source code of a robot's functions: one plan of statements, one printer and some templates for each language."""

from echelon.shared.facade import door

__all__, __getattr__, __dir__ = door(__name__)
