"""Exact algebra and recorded programs; knows nothing of robots.

``exact`` has numbers, polynomials, prime fields, elimination and the interpolation of closed forms.  ``program``
records formulas once, as straight-line programs, and evaluates them in any arithmetic: residues, balls, intervals,
doubles, expressions; it differentiates them and draws states at which signs differ.
"""

from echelon.shared.facade import door

__all__, __getattr__, __dir__ = door(__name__)
