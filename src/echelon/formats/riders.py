"""Links of a robot file that are fixed to others: where they are on the bodies that carry them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from echelon.formats.intent import Intent, symbol_stem
from echelon.formats.literal import LiteralPlacement, LiteralTree
from echelon.mechanism.placement import Placement
from echelon.mechanism.reading import Rider


class Riders(Mapping[str, Rider]):
    """Links that are fixed to others, by name; their numbers are read as exact ones when they are asked for.

    Parameters
    ----------
    tree : LiteralTree
    intent : Intent
        That has read the bodies already.
    rides : mapping of int to (int, tuple of LiteralPlacement)
        For every fixed link the body that carries it, and the placements from its frame to the link's.
    """

    def __init__(
        self, tree: LiteralTree, intent: Intent, rides: Mapping[int, tuple[int, tuple[LiteralPlacement, ...]]]
    ) -> None:
        self._intent = intent
        self._rides = {tree.links[link].name: ride for link, ride in rides.items()}

    def __iter__(self) -> Iterator[str]:
        return iter(self._rides)

    def __len__(self) -> int:
        return len(self._rides)

    def __getitem__(self, name: str) -> Rider:
        (body, placements), known = self._rides[name], len(self._intent.snaps)
        placed = Placement()
        for placement in placements:
            placed = placed @ self._intent.placement(placement, symbol_stem(name))
        symbols = tuple(self._intent.symbols[symbol] for symbol in placed.symbols())
        return Rider(body, placed, symbols, tuple(self._intent.snaps[known:]))
