"""Couplings as files state them, with constant parts and chains, and what they mean for independent coordinates."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from echelon.errors import InputError
from echelon.exact.polynomial import Polynomial
from echelon.mechanism.coupling import Coupling
from echelon.mechanism.spline import Spline


@dataclass(frozen=True)
class StatedCoupling:
    """q_coordinate = Σ f_k(q_k) + offset."""

    element: str  # what states it: a mimic element, an equality constraint, an entry of a description
    coordinate: str
    terms: Mapping[str, Spline]  # functions of other coordinates, which may be dependent themselves
    offset: Polynomial  # the constant part; of rotations it may contain pi

    @property
    def coupling(self) -> Coupling:
        """The coupling without its offset, which belongs into the geometry."""
        return Coupling(self.coordinate, tuple(self.terms.items()))


def resolved(couplings: Iterable[StatedCoupling], error: Callable[[str, str], InputError]) -> dict[str, StatedCoupling]:
    """Couplings by coordinate, with chains of dependent coordinates followed to independent ones."""
    stated: dict[str, StatedCoupling] = {}
    for coupling in couplings:
        earlier = stated.setdefault(coupling.coordinate, coupling)
        if earlier is not coupling:
            raise error(coupling.element, f"'{coupling.coordinate}' is already coupled in {earlier.element}")
    known: dict[str, StatedCoupling] = {}
    for name in stated:
        path = [] if name in known else [name]
        while path:
            coupling = stated[path[-1]]
            later = next((leader for leader in coupling.terms if leader in stated and leader not in known), None)
            if later is None:
                known[path.pop()] = substituted(coupling, known, error)
            elif later in path:
                circle = " -> ".join([*path[path.index(later) :], later])
                raise error(coupling.element, f"the couplings form a circle: {circle}")
            else:
                path.append(later)
    return {name: known[name] for name in stated}


def substituted(
    coupling: StatedCoupling, known: Mapping[str, StatedCoupling], error: Callable[[str, str], InputError]
) -> StatedCoupling:
    """A coupling with functions of independent coordinates in the place of dependent ones."""
    terms: dict[str, Spline] = {}
    offset = coupling.offset
    for name, function in coupling.terms.items():
        inner = {name: Spline((Polynomial.constant(1),))}
        constant = Polynomial({})
        if name in known:
            inner, constant = dict(known[name].terms), known[name].offset
        if function.ratio is None and len(inner) > 1:
            several = ", ".join(inner)
            raise error(coupling.element, f"'{name}' follows {several}, so only linear functions of it are supported")
        for independent, part in inner.items() or [(name, Spline(()))]:
            try:
                found, value = function.after(part, constant)
            except ValueError as problem:
                raise error(coupling.element, str(problem)) from None
            terms[independent] = terms.get(independent, Spline(())) + found
            offset, constant = offset + value, Polynomial({})
    moving = {name: function for name, function in terms.items() if function.expressions}
    return StatedCoupling(coupling.element, coupling.coordinate, moving, offset)
