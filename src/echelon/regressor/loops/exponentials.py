"""Exponentials of what moves in a mechanism with loops, such as those of Stribeck friction, as power series.

exp a(t) = exp a(0) · exp(a(t) − a(0)).  Exponentials of arguments that are linearly independent over the rationals,
up to constants, are algebraically independent on closed configurations, too (Ax 1971).  So generators have random
values at t = 0, and the rest is a power series.  Where loops tie arguments to one another, as in a parallelogram,
this is noticed and refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from echelon.errors import UnknownRelationsError
from echelon.exact import series
from echelon.exact.elimination import rank
from echelon.exact.field import PrimeField, Residues
from echelon.program.canonical import CanonicalForms, Product, Signs
from echelon.program.generator_values import residues_of
from echelon.program.schedule import Schedule

_UNKNOWN = 2  # last coefficients, which are not known of velocities and accelerations


class Exponentials:
    """The exponentials of a program whose arguments move."""

    def __init__(
        self, canonical: CanonicalForms, nodes: Sequence[int], signs: Sequence[int], functions: Sequence[int]
    ) -> None:
        self.nodes, self._canonical = nodes, canonical
        lhs = canonical.program.lhs
        self._sign_of = {lhs[node]: node for node in signs}
        self.arguments = Schedule(canonical.program, [lhs[node] for node in nodes], functions)

    def starts(
        self, signs: Mapping[int, Residues], field: PrimeField, rng: np.random.Generator, samples: int
    ) -> dict[int, Residues]:
        """Values at t = 0 by node, for given values of the nodes that are signs."""
        generators: dict[str, Residues] = {}
        starts = {node: np.zeros(samples, dtype=np.int64) for node in self.nodes}
        for node, wanted, where in self._regions(signs, samples):
            form = self._canonical.form(node, wanted)
            if not isinstance(form, Product) or any(self._canonical.generators[g].constant for g in form.exponents):
                raise UnknownRelationsError("a sum of constants and of what moves in an exponential, with loops")
            for generator in form.exponents:
                generators.setdefault(generator, field.draw(rng, (samples,)))
            own = {g: generators[g][where] for g in form.exponents}
            starts[node][where] = residues_of(form, own, field, len(where))
        return starts

    def _regions(self, signs: Mapping[int, Residues], samples: int) -> list[tuple[int, Signs, npt.NDArray[np.intp]]]:
        """Nodes with the signs that their arguments depend on, and the samples that have these; all forms are known."""
        found = []
        for node in self.nodes:
            watched = self._canonical.signed(node)
            table = np.array([signs[self._sign_of[n]] for n in watched], dtype=np.int64).reshape(len(watched), samples)
            rows, which = np.unique(np.where(table == 1, 1, -1).T, axis=0, return_inverse=True)
            for number, row in enumerate(rows):
                wanted = tuple(zip(watched, map(int, row), strict=True))
                found.append((node, wanted, np.flatnonzero(which.reshape(-1) == number)))
        self._canonical.forms([(node, wanted) for node, wanted, _ in found])
        return found

    def series(
        self, starts: Mapping[int, Residues], arguments: Residues, signs: Mapping[int, Residues], field: PrimeField
    ) -> dict[int, Residues]:
        """Series by node."""
        self._check_independent(arguments, signs, field)
        return {
            node: _exponential(argument, start, field)
            for node, start, argument in zip(self.nodes, starts.values(), arguments, strict=True)
        }

    def _check_independent(self, arguments: Residues, signs: Mapping[int, Residues], field: PrimeField) -> None:
        """The arguments of the first sample must be as independent as their exponents in generators say."""
        forms = []
        for node in self.nodes:
            watched = self._canonical.signed(node)
            wanted = tuple((n, 1 if int(signs[self._sign_of[n]][0]) == 1 else -1) for n in watched)
            forms.append(self._canonical.form(node, wanted))
        names = sorted({g for form in forms if isinstance(form, Product) for g in form.exponents})
        exponents = np.array([[f.exponents.get(g, 0) if isinstance(f, Product) else 0 for g in names] for f in forms])
        if rank(arguments[:, 0, 1:-_UNKNOWN], field) < rank(exponents % field.p, field):
            raise UnknownRelationsError("exponentials of velocities that the loops tie to one another")


def _exponential(argument: Residues, start: Residues, field: PrimeField) -> Residues:
    """start · exp(a − a(0)), from y' = a' y."""
    slope = series.derivative(argument, field)
    result = np.zeros_like(argument)
    result[:, 0] = start
    for n in range(1, argument.shape[-1]):
        total = (slope[:, :n] * result[:, n - 1 :: -1][:, :n] % field.p).sum(axis=1) % field.p
        result[:, n] = total * field.invert(n) % field.p
    return result
