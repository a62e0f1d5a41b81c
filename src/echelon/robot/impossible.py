"""Inertias that no body can have, in words, and the warning of whoever reckons with them.

A rigid body has a density of mass that is not negative, so its principal moments of inertia are not negative, and none
is larger than the sum of the others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from echelon.robot.inertia import convert
from echelon.robot.joint import Body
from echelon.shared import (
    PARAMETERS,
    PER_BODY,
    DoubtWarning,
    Floats,
    one_line,
    warn_caller,
)

ROUNDED = 1e-6  # relative; decimals of a file cannot help smaller violations
_NOTHING = 1e-15  # of the moments about the frame: what the way to the centre of mass leaves of a point
_SIZES = (
    0,
    3,
    5,
    9,
)  # places of XX, YY, ZZ and M among the standard parameters, which are never negative


def impossibility(inertial: Floats) -> str:
    """Reason why no body can have standard parameters, shape (10,); empty if one can."""
    mass = inertial[-1]
    if not np.isfinite(inertial).all():
        return "its inertia is not finite"
    if mass < 0:
        return f"its mass is negative: {mass:.4g} kg"
    if mass == 0:
        return "it has inertia, but no mass" if np.abs(inertial).max() > 0 else ""
    a, b, c = principal_moments(inertial)
    if a < -ROUNDED * abs(c):
        return f"a principal moment of inertia is negative: {a:.4g} kg·m²"
    if a + b < c * (1 - ROUNDED):
        short = 100 * (1 - (a + b) / c)
        return f"its principal moments {a:.4g}, {b:.4g}, {c:.4g} kg·m² break the triangle inequality by {short:.2g} %"
    return ""


def principal_moments(inertial: Floats) -> Floats:
    """Principal moments of inertia about the centre of mass, kg·m², shape (3,), rising; zero for a point."""
    xx, xy, xz, yy, yz, zz = convert(inertial, "echelon", "urdf")[4:]
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    largest = float(np.abs(moments[[0, -1]]).max())
    is_point = largest <= _NOTHING * float(np.abs(inertial[:6]).max())
    return np.zeros(3) if is_point else np.asarray(moments)


def stated_impossibilities(
    name: str, inertial: Sequence[float] | None
) -> tuple[str, ...]:
    """A link's name with the reason why no body can have the inertia that it states, if there is one."""
    problem = "" if inertial is None else impossibility(np.array(inertial, dtype=float))
    return (f"link '{one_line(name)}': {problem}",) if problem else ()


def warn_of_impossible(bodies: Sequence[Body]) -> None:
    """Warn of every link that is part of some bodies and whose stated inertia no body can have."""
    for text in dict.fromkeys(
        text for body in bodies for text in _impossibilities(body)
    ):
        warn_caller(
            f"{text}; values computed with it belong to no physical robot", DoubtWarning
        )


def _impossibilities(body: Body) -> Iterator[str]:
    if body.impossible or body.inertial is None or not body.carried:
        yield from body.impossible
    elif len(body.carried) == PER_BODY:
        yield from stated_impossibilities(body.name, body.inertial)
    else:  # of a rotor, only its inertia about its axis counts
        for place in sorted({*body.carried} & {*_SIZES}):
            if body.inertial[place] < 0:
                yield f"link '{one_line(body.name)}': {PARAMETERS[place]} is negative: {body.inertial[place]:.4g}"
