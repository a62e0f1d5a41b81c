"""Robots as frozen descriptions: bodies, joints, couplings, effects, outputs, loops, gravity, stated values.

A :class:`Mechanism` is what every reader of files makes and what all later rooms take. A joint is a sequence of
placements and elementary motions, which ``steps`` records as programs; ``inertia`` has the ten numbers of a body in
any convention.
"""

from echelon.shared.facade import door

__all__, __getattr__, __dir__ = door(__name__)
