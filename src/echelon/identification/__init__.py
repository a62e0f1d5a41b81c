"""From logs to a validated model.

``setup`` says what the columns of logs mean, ``logs`` reads them, names their faults and prepares them with the
filters of ``signals``.  ``identify`` makes rows of a base model, estimates, asks the ``judge`` what may be wrong or
lacking, fits parameters of physical bodies (``physics``) and validates.  ``servos`` fits drives without torque
sensors; ``saved`` writes identified models.
"""

from echelon.shared.facade import door

__all__, __getattr__, __dir__ = door(__name__)
