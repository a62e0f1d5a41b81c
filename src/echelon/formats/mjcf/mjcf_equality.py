"""Equality constraints of MJCF between coordinates: joints that follow others, and joints held at a constant value.

MuJoCo states y − y₀ = a₀ + a₁ (x − x₀) + … + a₄ (x − x₀)⁴ for two joints or two tendons, relative to their reference
positions, and y − y₀ = a₀ for one.  The length of a fixed tendon is a linear combination of joints.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from echelon.algebra import Polynomial, Rational, inverse, parse_decimal
from echelon.formats.literal import StatedCoupling, substituted
from echelon.formats.mjcf.mjcf_model import import_mujoco
from echelon.robot import Spline
from echelon.shared import InputError

JOINT = "joint"
TENDON = "tendon"
_SUPPORTED = (JOINT, TENDON, "connect", "weld")
_POLYCOEF = slice(0, 5)
_IGNORE = (
    "read the model without couplings (--mimic independent, independent_mimics=True)"
)


@dataclass(frozen=True)
class EqualityRelation:
    """Σ f_j(δ_j) + constant = 0, where δ_j is a joint's displacement from its reference position."""

    element: str
    dependent: str  # the joint that it determines; empty where any may be chosen
    terms: Mapping[str, Spline]  # by joint
    constant: Polynomial


def take_equalities(spec: Any, source: str) -> tuple[list[Any], list[str]]:
    """The active equalities of a spec, and notes; the others are deleted."""
    for flex in spec.flexes:
        raise InputError(
            "deformable bodies are not supported, only rigid ones",
            source=source,
            element=f"flex '{flex.name}'",
        )
    bits = import_mujoco().mjtDisableBit
    off = bits.mjDSBL_CONSTRAINT | bits.mjDSBL_EQUALITY
    active, notes = [], []
    for equality in list(spec.equalities):
        if not equality.active or spec.option.disableflags & off:
            notes.append(f"{equality_label(equality)} is ignored: it is not active")
            spec.delete(equality)
        elif _follows_mocap(equality, spec):
            notes.append(
                f"{equality_label(equality)} is ignored: it follows a body that is moved from outside (mocap)"
            )
            spec.delete(equality)
        elif equality_kind(equality) not in _SUPPORTED:
            raise InputError(
                f"of equality constraints only {', '.join(_SUPPORTED)} are supported",
                source=source,
                element=equality_label(equality),
            )
        else:
            active.append(equality)
    return active, notes


def _follows_mocap(equality: Any, spec: Any) -> bool:
    on_sites = str(equality.objtype.name) == "mjOBJ_SITE"
    moved = [body for body in spec.bodies if body.mocap]
    names = {
        part.name for body in moved for part in (body.sites if on_sites else [body])
    }
    return equality_kind(equality) not in (JOINT, TENDON) and not names.isdisjoint(
        (equality.name1, equality.name2)
    )


def read_relation(equality: Any, spec: Any, source: str) -> EqualityRelation:
    """Relation between joint positions that a joint or tendon equality states."""
    where = equality_label(equality)
    offset, *powers = (
        Polynomial.constant(parse_decimal(repr(float(a))))
        for a in equality.data[_POLYCOEF]
    )
    first, second = str(equality.name1), str(equality.name2)
    if equality_kind(equality) == JOINT:
        terms = {first: Spline((-_ONE,))}
        if second:
            terms[second] = Spline(tuple(powers))
        return EqualityRelation(where, first, terms, offset)
    terms = {
        name: Spline((-coefficient,))
        for name, coefficient in _joints(spec, first, source, where).items()
    }
    follows = _joints(spec, second, source, where) if second else {}
    if len(follows) > 1 and any(powers[1:]):
        raise InputError(
            f"a nonlinear function of {len(follows)} joints is not supported; {_IGNORE}",
            source=source,
            element=where,
        )
    for name, coefficient in follows.items():
        function, _ = Spline(tuple(powers)).after(
            Spline((coefficient,)), Polynomial({})
        )
        terms[name] = terms.get(name, Spline(())) + function
    return EqualityRelation(where, "", terms, offset)


def _joints(spec: Any, tendon: str, source: str, where: str) -> dict[str, Polynomial]:
    """Coefficients of the joints of a fixed tendon."""
    path = getattr(next(t for t in spec.tendons if t.name == tendon), "path", None)
    if path is None:
        raise InputError(
            "tendons need a newer version of the package mujoco",
            source=source,
            element=where,
        )
    found: dict[str, Polynomial] = {}
    for part in path:
        if part.type.name != "mjWRAP_JOINT":
            problem = f"tendon '{tendon}' is spatial; only fixed tendons are couplings of joints: {_IGNORE}"
            raise InputError(problem, source=source, element=where)
        name, coefficient = str(part.target.name), parse_decimal(repr(float(part.coef)))
        found[name] = found.get(name, Polynomial({})) + Polynomial.constant(coefficient)
    return found


def resolve(
    relations: Sequence[EqualityRelation],
    reference: Mapping[str, Rational],
    driven: Collection[str],
    source: str,
    sliding: Collection[str] = (),
) -> tuple[dict[str, Rational], tuple[StatedCoupling, ...], list[str]]:
    """Sort relations into joints that cannot move and joints that follow others.

    Where a joint equality's own joint follows already, or of the joints of a tendon, the last one that no actuator
    drives follows the others, if none follows it by a nonlinear function.  With loops, those that slide come first, as
    what turns along them has no exact sines.
    """

    def error(element: str, problem: str) -> InputError:
        return InputError(problem, source=source, element=element)

    known: dict[str, StatedCoupling] = {}
    notes: list[str] = []
    order = sorted(
        reference, key=lambda name: name not in driven
    )  # what shall follow, last
    for relation in sorted(relations, key=lambda relation: not relation.dependent):
        whole = substituted(
            StatedCoupling(relation.element, "", relation.terms, relation.constant),
            known,
            error,
        )
        left = EqualityRelation(relation.element, "", whole.terms, whole.offset)
        free = [
            name for name, function in left.terms.items() if function.ratio is not None
        ]
        if free:
            bent = {
                n
                for other in known.values()
                for n, function in other.terms.items()
                if function.ratio is None
            }
            last = max(
                free,
                key=lambda name: (name not in bent, name in sliding, order.index(name)),
            )
            as_stated = relation.dependent in free and (
                relation.dependent in sliding or last not in sliding
            )
            wanted = relation.dependent if as_stated else last
            coupling = _solved(left, wanted)
            for name in [
                name for name, other in known.items() if wanted in other.terms
            ]:
                known[name] = substituted(known[name], {wanted: coupling}, error)
            known[wanted] = coupling
        elif left.terms:
            bent_only = f"it holds nonlinear functions of {', '.join(left.terms)} only"
            raise error(
                relation.element,
                f"it cannot be solved for one of its joints: {bent_only}; {_IGNORE}",
            )
        elif left.constant:
            raise error(
                relation.element,
                f"it contradicts the other equalities by {float(_number(left.constant)):.3g}",
            )
        else:
            notes.append(f"{relation.element} follows from the other equalities")
    held = {c.coordinate: _number(c.offset) for c in known.values() if not c.terms}
    return held, tuple(_counted(c, reference) for c in known.values() if c.terms), notes


def _solved(relation: EqualityRelation, joint: str) -> StatedCoupling:
    """A relation as one joint's displacement."""
    ratio = relation.terms[joint].ratio
    assert ratio is not None
    factor = -Polynomial.constant(inverse(_number(ratio)))
    others = {
        n: f.mapped(lambda c: c * factor)
        for n, f in relation.terms.items()
        if n != joint
    }
    return StatedCoupling(relation.element, joint, others, relation.constant * factor)


def _counted(
    coupling: StatedCoupling, reference: Mapping[str, Rational]
) -> StatedCoupling:
    """A coupling of displacements as one of positions, which count from the reference positions."""
    offset = coupling.offset + reference[coupling.coordinate]
    terms: dict[str, Spline] = {}
    for name, function in coupling.terms.items():
        terms[name], constant = function.after(
            Spline((_ONE,)), Polynomial.constant(-reference[name])
        )
        offset = offset + constant
    return StatedCoupling(coupling.element, coupling.coordinate, terms, offset)


def _number(value: Polynomial) -> Rational:
    number = value.number
    assert isinstance(number, int | Fraction)
    return number


_ONE = Polynomial.constant(1)


def equality_kind(equality: Any) -> str:
    """Kind of a constraint, such as ``connect``."""
    return str(equality.type.name).removeprefix("mjEQ_").lower()


def equality_label(equality: Any) -> str:
    """Name of a constraint for messages, by what it connects if it has none."""
    name = equality.name or " and ".join(
        n for n in (equality.name1, equality.name2) if n
    )
    return f"equality {equality_kind(equality)} '{name}'"
