"""Robot files: readers, what their numbers mean, and writers.

URDF, SDF, MJCF and DH tables become a literal tree of names and decimals; ``snapping`` and ``bodies`` decide what
the numbers stand for; ``builder`` makes the mechanism. A description in YAML is read directly.
"""

from echelon.shared.facade import door

__all__, __getattr__, __dir__ = door(__name__)
