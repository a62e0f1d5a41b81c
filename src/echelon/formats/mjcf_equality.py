"""Equality constraints of MJCF, and what those of joints mean: linear couplings, and joints held at a constant value.

MuJoCo states y − y₀ = a₀ + a₁ (x − x₀) + … + a₄ (x − x₀)⁴ for two joints, relative to their reference positions, and
y − y₀ = a₀ for one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from echelon.errors import InputError
from echelon.exact.numbers import Rational, parse_decimal
from echelon.formats.literal import LiteralCoupling

JOINT = "joint"
_SUPPORTED = (JOINT, "connect", "weld")
_SIZE = 5  # coefficients of polycoef


@dataclass(frozen=True)
class JointEquality:
    """One ``<equality><joint/>`` element.

    Attributes
    ----------
    element : str
    dependent : str
    leader : str
        Empty if the dependent joint is held at a constant value.
    offset, ratio : numbers
        The coefficients a₀ and a₁.
    """

    element: str
    dependent: str
    leader: str
    offset: Rational
    ratio: Rational


def take_equalities(spec: Any, source: str) -> tuple[list[Any], list[str]]:
    """The active equalities of a spec, and notes; the others are deleted.

    Raises
    ------
    InputError
        If the model has active constraints of another kind, or deformable bodies.
    """
    for flex in spec.flexes:
        raise InputError(
            "deformable bodies are not supported, only rigid ones", source=source, element=f"flex '{flex.name}'"
        )
    active, notes = [], []
    for equality in list(spec.equalities):
        if not equality.active:
            notes.append(f"{equality_label(equality)} is ignored: it is not active")
            spec.delete(equality)
        elif _follows_mocap(equality, spec):
            notes.append(f"{equality_label(equality)} is ignored: it follows a body that is moved from outside (mocap)")
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
    names = {part.name for body in moved for part in (body.sites if on_sites else [body])}
    return equality_kind(equality) != JOINT and not names.isdisjoint((equality.name1, equality.name2))


def read_equality(equality: Any, source: str) -> JointEquality:
    """The numbers of a joint equality.

    Raises
    ------
    InputError
        If the relation is not linear.
    """
    coefficients = [parse_decimal(repr(float(a))) for a in equality.data[:_SIZE]]
    leader = str(equality.name2)
    if leader and any(coefficients[2:]):
        shown = " ".join(repr(float(a)) for a in equality.data[:_SIZE])
        raise InputError(
            f"polycoef {shown} is not linear; only linear couplings (third to fifth coefficient zero) are supported",
            source=source,
            element=equality_label(equality),
        )
    ratio = coefficients[1] if leader else 0
    return JointEquality(equality_label(equality), str(equality.name1), leader if ratio else "", coefficients[0], ratio)


def resolve(
    equalities: list[JointEquality], reference: Mapping[str, Rational], source: str
) -> tuple[dict[str, Rational], tuple[LiteralCoupling, ...]]:
    """Sort equalities into joints that cannot move and joints that follow others.

    Parameters
    ----------
    equalities : list of JointEquality
    reference : mapping of str to number
        Reference position of every joint that can be coupled.
    source : str

    Returns
    -------
    held : dict of str to number
        Displacement from the reference position, by joint.
    couplings : tuple of LiteralCoupling

    Raises
    ------
    InputError
        If two equalities constrain the same joint.
    """
    by_joint: dict[str, JointEquality] = {}
    for equality in equalities:
        earlier = by_joint.setdefault(equality.dependent, equality)
        if earlier is not equality:
            problem = f"{earlier.element} already constrains joint '{equality.dependent}'; one constraint is allowed"
            raise InputError(problem, source=source, element=equality.element)
    held = {e.dependent: e.offset for e in by_joint.values() if not e.leader}
    following = {e.dependent: e for e in by_joint.values() if e.leader}
    while stopped := [e for e in following.values() if e.leader in held]:  # who follows a held joint is held
        for equality in stopped:
            held[equality.dependent] = equality.offset + equality.ratio * held[equality.leader]
            del following[equality.dependent]
    return held, tuple(_coupling(e, reference) for e in following.values())


def _coupling(equality: JointEquality, reference: Mapping[str, Rational]) -> LiteralCoupling:
    leader, dependent = reference[equality.leader], reference[equality.dependent]
    offset = dependent + equality.offset - equality.ratio * leader
    return LiteralCoupling(equality.element, equality.dependent, equality.leader, equality.ratio, offset)


def equality_kind(equality: Any) -> str:
    """Kind of a constraint, such as ``connect``."""
    return str(equality.type.name).removeprefix("mjEQ_").lower()


def equality_label(equality: Any) -> str:
    """Name of a constraint for messages, by what it connects if it has none."""
    name = equality.name or " and ".join(n for n in (equality.name1, equality.name2) if n)
    return f"equality {equality_kind(equality)} '{name}'"
