"""What geometry symbols stand for (lengths, angles, other constants), and their numeric values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.exact.polynomial import Polynomial, is_trigonometric, symbol_of
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism, setup_expressions, setup_placements, setup_ratios
from echelon.mechanism.placement import Placement
from echelon.program.text import phase_symbols


def symbol_values(
    mechanism: Mechanism, names: Iterable[str], overrides: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Values of symbols, SI units."""
    given = dict(overrides or {})
    if given:
        known = all_symbols(mechanism)
        strange = next((name for name in given if name not in known), None)
        if strange is not None:
            valid = ", ".join(sorted(known)) or "none"
            raise InputError(f"'{strange}' is not a symbol of this mechanism (valid: {valid})")
    values: dict[str, float] = {}
    for name in names:
        stated = mechanism.symbols.get(name)
        value = given.get(name, stated.value if stated else None)
        if value is None:
            raise InputError(f"symbol '{name}' has no value; give it as symbols={{'{name}': ...}}")
        values[name] = value
    return values


def all_symbols(mechanism: Mechanism) -> set[str]:
    """All symbols that a mechanism lists or uses."""
    used = {name for body in mechanism.bodies for name in body.joint.symbols()}
    used |= {name for value in setup_expressions(mechanism) for name in value.symbols()}
    used |= {name for part in mechanism.gravity or () for name in part.symbols()}
    return used | set(mechanism.symbols)


def known_values(mechanism: Mechanism) -> dict[str, float]:
    """Values of the symbols that have one."""
    return {name: s.value for name, s in mechanism.symbols.items() if s.value is not None}


def has_values(mechanism: Mechanism) -> bool:
    """Whether all symbols that a mechanism lists or uses have one."""
    return all_symbols(mechanism) <= known_values(mechanism).keys()


def placement_matrix(placement: Placement, symbols: Mapping[str, float]) -> npt.NDArray[np.float64]:
    """A placement as a homogeneous matrix, shape (4, 4)."""

    def number(entry: Polynomial) -> float:
        return entry.at(symbols)

    matrix = np.eye(4)
    matrix[:3, :3] = [[number(entry) for entry in row] for row in placement.rotation]
    matrix[:3, 3] = [number(entry) for entry in placement.translation]
    return matrix


def characteristic_length(mechanism: Mechanism) -> float:
    """The largest offset of a joint, loops' joints included, whose value is known, m; 1 if there is none."""
    known = known_values(mechanism)
    placements = [step for body in mechanism.bodies for step in body.joint.steps if isinstance(step, Placement)]
    placements += [frame for closure in mechanism.closures for frame in (closure.first_frame, closure.second_frame)]
    entries = [entry for placement in placements for entry in placement.translation]
    values = [e.at(known) for e in entries if known.keys() >= set(e.symbols())]
    largest = max(map(abs, values), default=0.0)
    return largest if largest > 1e-300 else 1.0


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
    terms = [action.term for effect in mechanism.effects for action in effect.actions]
    angles |= {name for term in terms for name in phase_symbols(term) if name in mechanism.symbols}
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
