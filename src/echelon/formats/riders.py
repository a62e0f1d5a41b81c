"""Links and frames of a robot file that are fixed to others: where they are on the bodies that carry them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from echelon.formats.intent import Intent, symbol_stem
from echelon.formats.literal import LiteralPlacement
from echelon.mechanism.mechanism import Symbol
from echelon.mechanism.placement import Placement
from echelon.mechanism.reading import Snap

Ride = tuple[int, tuple[LiteralPlacement, ...]]
"""The body that carries something, and the placements from its frame to what it carries."""


@dataclass(frozen=True)
class Rider:
    """A link that is fixed to another and counts as part of a body."""

    body: int  # index of the body that carries it, or GROUND
    placement: Placement  # its frame in the body's frame
    symbols: tuple[Symbol, ...] = ()  # those of the placement
    snaps: tuple[Snap, ...] = ()  # numbers of the placement that were read as nearby exact ones


class Riders(Mapping[str, Rider]):
    """What is fixed to bodies, by name; its numbers are read as exact ones when they are asked for."""

    def __init__(self, intent: Intent, rides: Mapping[str, Ride]) -> None:
        self._intent, self._rides = intent, rides

    def __iter__(self) -> Iterator[str]:
        return iter(self._rides)

    def __len__(self) -> int:
        return len(self._rides)

    def __getitem__(self, name: str) -> Rider:
        (body, placements), known = self._rides[name], len(self._intent.snaps)
        placed = Placement()
        for placement in placements:
            placed = placed @ self._intent.placement(placement, symbol_stem(name))
        placed = self._intent.without_noise(placed, f"frame '{name}'")
        symbols = tuple(self._intent.symbols[symbol] for symbol in placed.symbols())
        return Rider(body, placed, symbols, tuple(self._intent.snaps[known:]))
