"""Mechanisms with loops: poses in which they close, motions that keep them closed, and random closed states.

:func:`close` reads a mechanism's loops and chooses its independent coordinates. From there on, :class:`Assembly`
walks from the assembly pose to other closed poses in double precision; :class:`ClosedMotion` and
:class:`DependentMotion` complete velocities and accelerations, in numbers and as recorded formulas; and
:class:`Loops` keeps recorded rows on closed states, which :func:`closed_states` encloses in ball arithmetic.
"""

from echelon.shared.facade import door

__all__, __getattr__, __dir__ = door(__name__)
