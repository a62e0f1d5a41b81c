"""Two robots compared by what their sensors see.

The job is :mod:`echelon.comparison.comparing`: bodies are paired and the geometry is compared
(:mod:`echelon.base.kinematic_match`), inertial values are compared in base parameters, and outputs over all states
within limits (:mod:`echelon.comparison.outputs`).  :mod:`echelon.comparison.result` holds what was found.
"""

from echelon.shared.facade import door

__all__, __getattr__, __dir__ = door(__name__)
