"""Base parameters: structure, closed forms, certificate, and the :class:`BaseModel` that carries them.

``structure`` finds rank and pivots of random rows, ``derive`` the coefficients of the others in closed form or as
numbers, and ``certificate`` proves the set by rows that are derived in another way.  ``saved`` writes and reads sets
and checks them again; ``audit`` says exactly what is right and wrong about sets claimed by others.
"""

from echelon.shared.facade import door

__all__, __getattr__, __dir__ = door(__name__)
