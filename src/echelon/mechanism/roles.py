"""What geometry symbols stand for: lengths, angles, or other constants."""

from __future__ import annotations

from dataclasses import dataclass

from echelon.exact.polynomial import Polynomial, is_trigonometric, symbol_of
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism, setup_placements, setup_ratios
from echelon.mechanism.placement import Placement


@dataclass(frozen=True)
class SymbolRoles:
    """Roles of a mechanism's symbols."""

    # symbols with the dimension of a length; empty if lengths are not all symbolic, because then coefficients are not
    # homogeneous in them
    lengths: frozenset[str]
    angles: frozenset[str]
    symbols: frozenset[str]  # all symbols
    irrational: tuple[bool, bool]  # whether √2 and √3 occur in the geometry


def symbol_roles(mechanism: Mechanism) -> SymbolRoles:
    """Sort a mechanism's symbols by role."""
    translations, others = _expressions(mechanism)
    everything = translations + others
    angles = {symbol_of(g) for e in everything for g in e.generators() if is_trigonometric(g)}
    lengths = {s for e in translations for s in e.symbols()} - angles
    foreign = {g for e in others for g in e.generators() if not is_trigonometric(g)}
    homogeneous = all(_is_length(e, lengths) for e in translations) and not _mixes_dimensions(mechanism)
    roots = [part for e in everything for c in e.terms.values() for part in getattr(c, "parts", ())]
    quadruples = [roots[k : k + 4] for k in range(0, len(roots), 4)]
    irrational = (any(q[1] or q[3] for q in quadruples), any(q[2] or q[3] for q in quadruples))
    usable = homogeneous and not lengths & foreign
    symbols = frozenset(s for e in everything for s in e.symbols())
    return SymbolRoles(frozenset(lengths) if usable else frozenset(), frozenset(angles), symbols, irrational)


def _expressions(mechanism: Mechanism) -> tuple[list[Polynomial], list[Polynomial]]:
    """All geometry expressions: those that are lengths, and the others."""
    translations: list[Polynomial] = []
    others: list[Polynomial] = list(mechanism.gravity or ())
    for body in mechanism.bodies:
        for step in body.joint.steps:
            if isinstance(step, Placement):
                translations.extend(step.translation)
                others.extend(entry for row in step.rotation for entry in row)
            else:
                translations.append(step.pitch)
    for placement in setup_placements(mechanism):
        translations.extend(placement.translation)
        others.extend(entry for row in placement.rotation for entry in row)
    others.extend(setup_ratios(mechanism))
    return translations, others


def _is_length(expression: Polynomial, lengths: set[str]) -> bool:
    """Whether every term has degree one in the length symbols."""
    return all(sum(e for g, e in monomial if g in lengths) == 1 for monomial in expression.terms)


def _mixes_dimensions(mechanism: Mechanism) -> bool:
    """Whether a coupling has plain coefficients with a dimension, as between a translation and a rotation."""
    sliding = {m.name: m.kind is MotionKind.TRANSLATION for m in mechanism.motions}
    return any(
        sliding[c.coordinate] != sliding[name] or (sliding[name] and function.ratio is None)
        for c in mechanism.couplings
        for name, function in c.terms
    )
