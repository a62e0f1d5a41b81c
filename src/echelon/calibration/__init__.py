"""Calibration of the geometry: which small errors measurements show, and their values.

``errors`` records small errors beside the steps of a robot, ``sights`` what measurements see, ``model`` the combinations
that can be known.
"""

from echelon.shared.facade import door

__all__, __getattr__, __dir__ = door(__name__)
