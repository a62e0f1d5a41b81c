"""Calibration of the geometry: which small errors measurements show, and their values.

The job is :mod:`echelon.calibration.calibrating`.  ``errors`` records small errors beside the steps of a robot,
``sights`` what measurements see, ``model`` the combinations that can be known; ``log`` reads poses, ``fit`` finds
values, ``applied`` makes the calibrated robot, and ``poses`` chooses where to measure.
"""

from echelon.shared.facade import door

__all__, __getattr__, __dir__ = door(__name__)
