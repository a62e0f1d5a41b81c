"""The closures of a literal tree, exactly."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from operator import matmul

from echelon.errors import InputError
from echelon.formats.intent import Intent, symbol_stem
from echelon.formats.literal import LiteralClosure, LiteralPlacement, LiteralTree
from echelon.formats.second_frame import second_frame
from echelon.mechanism.closure import Closure
from echelon.mechanism.placement import Placement

Ride = Callable[[int], tuple[int, tuple[LiteralPlacement, ...]]]
"""The body that carries a link, and the placements from its frame to the link's."""


def build_closure(closure: LiteralClosure, tree: LiteralTree, intent: Intent, ride: Ride) -> Closure:
    """A closure between bodies."""
    (first, offset), (second, other) = ride(closure.first), ride(closure.second)
    stem = symbol_stem(closure.name)
    frame = _placed(intent, closure.first_frame, stem)
    if closure.second_frame is None:
        met = _at_reference(tree, intent, closure, frame)
    else:
        met = _placed(intent, closure.second_frame, stem)
    frame, met = _placed(intent, offset, stem) @ frame, _placed(intent, other, stem) @ met
    return Closure(closure.name, closure.kind, first, second, frame, met)


def _at_reference(tree: LiteralTree, intent: Intent, closure: LiteralClosure, frame: Placement) -> Placement:
    """Where the frame of the first link is on the second one at the reference pose."""
    links = tree.links
    try:
        return second_frame(
            closure.kind,
            closure.first,
            closure.second,
            frame,
            lambda k: links[k].parent,
            lambda k: _placed(intent, links[k].rest, symbol_stem(links[k].name)),
        )
    except ValueError as error:
        raise InputError(str(error), source=tree.source, element=closure.element) from None


def _placed(intent: Intent, placements: tuple[LiteralPlacement, ...], stem: str) -> Placement:
    return reduce(matmul, (intent.placement(placement, stem) for placement in placements), Placement())
