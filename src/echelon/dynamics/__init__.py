"""Functions of robots as recorded programs.

``linear_forms`` records energies and virtual power, from which ranks and certificates follow; ``recursion`` records
inverse dynamics in another way, for evaluation.  ``functions`` is the table of what can be evaluated or generated
(torques, mass matrix, regressors, Jacobians, ...), and ``evaluator`` runs it as machine code.  ``models`` has models
that are linear in their parameters and no mechanisms.
"""

from echelon.shared.facade import door

__all__, __getattr__, __dir__ = door(__name__)
