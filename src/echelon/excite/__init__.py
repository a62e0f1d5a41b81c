"""Exciting trajectories: motions that make base parameters visible and keep all limits at every time.

The job is :mod:`echelon.excite.excite`.  ``problem`` states what is asked for, ``solve`` finds a motion, ``verify``
shows that it keeps its limits between samples too, and ``files`` reads and writes trajectories.
"""

from echelon.shared.facade import door

__all__, __getattr__, __dir__ = door(__name__)
