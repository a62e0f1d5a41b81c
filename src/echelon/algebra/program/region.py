"""Regions of the real inputs: which signs occur together, a point of each, and which of them add something.

A sign is constant on a region of the real inputs, and not every combination of signs is a region: sign(x), sign(y) and
sign(x + y) have six of eight.  The row space of a model is that of the union over its regions.  Within a region all is
analytic, so random points of a field stand for any of its points once the signs are known; so signs are taken from
regions that surely exist, and every sample set visits all of them in turn.  Points on the surfaces themselves, where a
sign is zero, are left out.

Random points of all magnitudes come first.  From every region found, each sign is then changed by itself, by descent to
the wanted signs with steps of all sizes, so that a region's size and distance do not matter.  Only regions that add
something count, and every one is proved to exist by ball arithmetic at its point.

The search ends when as many regions add something as products of signs occur, less the relations between them that
parallel surfaces bring (:mod:`echelon.algebra.program.surfaces`): then no other region can matter.  Else it ends
when no change
of one sign from a region found led to one that adds something, or when its budget of counted tries is spent.  Then it
is an assumption that no other region adds anything, and the report says so.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from echelon.algebra.program.region_moves import descended, random_points
from echelon.algebra.program.surfaces import (
    IndependentRegions,
    RealValues,
    Surfaces,
    impossible,
    monomials,
    relations,
)
from echelon.shared import Floats, SignArray

COMPLETE, EXHAUSTED, BUDGET = "complete", "exhausted", "budget"

_AROUND = (1e-4, 1e-7, 1e-10)
"""Relative distances of points around one on a surface, whose other signs they share."""


@dataclass(frozen=True)
class Effort:
    """How hard a search tries, counted and not timed, so that it ends alike on every machine."""

    random_points: int = 512
    """Random points at first."""
    products: int = 512
    """Most products of signs for which the independent regions are counted; with more, every region counts."""
    regions: int = 2048
    """Regions after which the search ends."""
    tries: int = 3000
    """Descents after which the search ends."""
    batch: int = 256
    """Descents at once, which takes little longer than one."""
    starts: int = 3
    """Points from which each descent starts, all but one in other regions."""
    repeats: int = 2
    """Descents to a combination of signs before it counts as impossible."""
    kept_points: int = 24
    """Points that are kept of a region, from which samples and descents start."""
    proofs: int = 4
    """Points of a region that are tried until ball arithmetic proves its signs at one."""


EFFORT = Effort()


@dataclass
class Region:
    """One region."""

    signs: SignArray
    points: list[Floats] = field(default_factory=list)  # the first is certain


class RegionSearch:
    """Finds the regions of some surfaces."""

    def __init__(self, values: RealValues, rng: np.random.Generator) -> None:
        self.values, self.rng = values, rng
        self.surfaces: Surfaces = values.surfaces
        self.regions: list[Region] = []
        self.ended = EXHAUSTED
        self._known: dict[bytes, Region] = {}
        self._failed: dict[tuple[int, bytes], int] = {}
        self._tries = 0
        self._weights = rng.integers(
            -(2**62), 2**62, len(self.surfaces.nodes)
        )  # tell sign vectors apart
        start = self._start()
        self.zero = values.vanishing(start[:, :4])
        self.constant = {
            n: s for n, s in values.one_sided().items() if n not in self.zero
        }
        self._fixed = {**dict.fromkeys(self.zero, 0), **self.constant}
        row = {n: k for k, n in enumerate(self.surfaces.nodes)}
        self._open = [row[n] for n in self.surfaces.nodes if n not in self._fixed]
        self._partners = [self._multiplied_with(n) for n in self.surfaces.nodes]
        products = monomials(self.surfaces, self._fixed, EFFORT.products)
        if products is None:
            self._independent = IndependentRegions(None)
        else:
            known = relations(products, impossible(self.surfaces, values.constants))
            self._independent = IndependentRegions(
                [tuple((row[n], e) for n, e in p) for p in products], known
            )
        self._visit(start)

    def run(self) -> None:
        """Search until nothing can be added, nothing more is found, or the budget is spent."""
        while self.regions and not self._settled() and self._change_signs():
            pass

    def _settled(self) -> bool:
        if self._independent.complete:
            self.ended = COMPLETE
        elif len(self.regions) >= EFFORT.regions or self._tries >= EFFORT.tries:
            self.ended = BUDGET
        else:
            return False
        return True

    def _start(self) -> Floats:
        """Random points in the domain; where chance finds none, by descent."""
        points = self.values.normal(
            random_points(self.rng, len(self.values.variables), EFFORT.random_points)
        )
        inside = points[:, self.values.in_domain(self.values.at(points))]
        if not inside.shape[1] and len(points):
            moved = descended(
                self.values,
                points,
                np.zeros((len(self.surfaces.nodes), points.shape[1])),
                self.rng,
            )
            inside = moved[:, self.values.in_domain(self.values.at(moved))]
        return inside

    def _multiplied_with(self, node: int) -> list[int]:
        """Rows of the surfaces whose signs are multiplied with that of one."""
        together = {
            n for product in self.surfaces.maximal if node in product for n in product
        }
        return [k for k, n in enumerate(self.surfaces.nodes) if n in together]

    # -- regions -----------------------------------------------------------------------------------------------------

    def _visit(self, points: Floats) -> None:
        """Take note of the regions of some points."""
        if self._settled() and self.regions:
            return
        points = self.values.normal(points.copy())
        table = self.values.at(points)
        good = self.values.inside(table) | self._on_zero(table)
        signs = self._signs(table[: len(self.surfaces.nodes), good])
        self._note(points[:, good], signs)

    def _on_zero(self, table: Floats) -> npt.NDArray[np.bool_]:
        """Points that only seem to be on a surface, because it is zero everywhere."""
        if not self.zero:
            return np.zeros(table.shape[1], dtype=bool)
        filled = table.copy()
        filled[[k for k, n in enumerate(self.surfaces.nodes) if n in self.zero]] = 1.0
        return self.values.inside(filled)

    def _signs(self, table: Floats) -> SignArray:
        signs = np.sign(table).astype(np.int8)
        for k, n in enumerate(self.surfaces.nodes):
            if n in self._fixed:
                signs[k] = self._fixed[n]
        return signs

    def _note(self, points: Floats, signs: SignArray) -> None:
        """Sort points by region; those of order one come first, because functions are tame there."""
        if not points.shape[1]:
            return
        _, first, which = np.unique(
            self._weights @ signs.astype(np.int64),
            return_index=True,
            return_inverse=True,
        )
        kinds, which = signs[:, first], which.reshape(-1)
        decades = np.abs(
            np.log10(np.maximum(np.abs(points), np.finfo(float).tiny))
        ).max(axis=0, initial=0.0)
        members: list[list[int]] = [[] for _ in range(kinds.shape[1])]
        for k in np.argsort(decades, kind="stable"):
            if len(members[which[k]]) < EFFORT.kept_points:
                members[which[k]].append(int(k))
        new = []
        for k in range(kinds.shape[1]):
            region = self._known.get(kinds[:, k].tobytes())
            if region is None:
                new.append(k)
            else:
                region.points += [
                    points[:, m].copy()
                    for m in members[k][: EFFORT.kept_points - len(region.points)]
                ]
        self._include(kinds[:, new], [points[:, members[k]] for k in new])

    def _include(self, kinds: SignArray, points: list[Floats]) -> None:
        """Keep those regions that add something and surely exist."""

        def exists(k: int) -> bool:
            own = list(points[k].T.copy())
            for point in (
                own[: EFFORT.proofs] if len(self.regions) < EFFORT.regions else []
            ):
                if self._is_certain(point, kinds[:, k]):
                    region = Region(
                        kinds[:, k].copy(), [point, *(p for p in own if p is not point)]
                    )
                    self.regions.append(region)
                    self._known[kinds[:, k].tobytes()] = region
                    return True
            return False

        self._independent.include(kinds, exists)

    def _is_certain(self, point: Floats, signs: SignArray) -> bool:
        """Whether a point surely has these signs; and points around it, where one of them is zero."""
        around = [point]
        if (signs[self._open] == 0).any():
            around += [
                point + e * (np.abs(point) + e) * self.rng.standard_normal(len(point))
                for e in _AROUND
            ]
        found = [self.values.certain(p, frozenset(self._fixed)) for p in around]
        same = [
            s is not None and bool((s[self._open] == signs[self._open]).all())
            for s in found
        ]
        return same[0] and (len(same) == 1 or any(same[1:]))

    # -- moves -------------------------------------------------------------------------------------------------------

    def _targets(self) -> Iterator[tuple[Region, int, SignArray]]:
        """Regions with one sign changed, where that would add something."""
        for region in self.regions:
            changed = np.repeat(region.signs[:, None], len(self._open), axis=1)
            own = region.signs[self._open]
            changed[self._open, range(len(self._open))] = np.where(own, -own, 1)
            adds = self._independent.adds(changed)
            for m in np.flatnonzero(adds):
                if changed[:, m].tobytes() not in self._known:
                    yield region, self._open[m], changed[:, m]

    def _change_signs(self) -> bool:
        """Descend to regions with one sign changed; returns whether there was anything left to try."""
        batch: list[tuple[Region, SignArray]] = []
        for region, k, signs in self._targets():
            key = (k, signs[self._partners[k]].tobytes())
            if self._failed.get(key, 0) < EFFORT.repeats:
                self._failed[key] = self._failed.get(key, 0) + 1
                batch.append((region, signs))
            if len(batch) == EFFORT.batch:
                break
        if not batch:
            return False
        self._tries += len(batch)
        starts, wanted = [], []
        for region, signs in batch:
            others = [
                self.regions[int(self.rng.integers(len(self.regions)))]
                for _ in range(EFFORT.starts - 1)
            ]
            for r in (region, *others):
                starts.append(r.points[int(self.rng.integers(len(r.points)))])
                wanted.append(
                    np.where(np.isin(np.arange(len(signs)), self._open), signs, 0)
                )
        moved = descended(
            self.values,
            np.stack(starts, axis=1),
            np.stack(wanted, axis=1).astype(float),
            self.rng,
        )
        self._visit(moved)
        return True
