"""Whether any robot that can exist has given base parameters, with a proof either way.

Solvers answer in floats; near the boundary their yes or no is worth little.  So their answer is only a hint, from which
a proof in exact arithmetic is made.  B is in reduced echelon form: any rational values of the parameters that are no
pivots give pivots with which B ζ = ζ̄ holds exactly, so a robot well inside stays one, and LDLᵀ over the rationals
verifies it.  If there is none, a linear function separates the values from all robots
(:mod:`echelon.identification.physics.separation`).
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.base.model import BaseModel
from echelon.conventions import PER_BODY
from echelon.errors import EchelonError, InputError
from echelon.identification.physics.constraints import Roles, roles
from echelon.identification.physics.dual_problem import DualProblem
from echelon.identification.physics.exact_algebra import as_fraction
from echelon.identification.physics.exact_base import ExactBase, exact_base, precision, rational_number
from echelon.identification.physics.nearest import checked_values, nearest_physical, physical_lift, sizes_of
from echelon.identification.physics.pseudo_inertia import exact_pseudo_inertia, is_semidefinite
from echelon.identification.physics.result import Feasibility
from echelon.identification.physics.separation import separator
from echelon.mechanism.values import characteristic_length


def feasibility(
    base: BaseModel,
    values: npt.ArrayLike,
    covariance: npt.ArrayLike | None = None,
    *,
    solver: str = "CLARABEL",
) -> Feasibility:
    """Whether a robot that can exist has given base parameters.

    Every body that carries all ten parameters needs J ≻ 0; signs of the others are those of
    :mod:`echelon.identification.physics.constraints`.

    Parameters
    ----------
    base : BaseModel
    values : array of shape (r,)
        Base parameters, SI units; floats are taken as the dyadic fractions that they are.
    covariance : array of shape (r, r), optional
        Of the values, for the distance to the nearest robot; without it the distance is relative to the sizes of the
        values.
    solver : str

    Returns
    -------
    Feasibility
        ``feasible`` is None where the values are so near to the boundary that neither was proved.

    Raises
    ------
    InputError
        If values or covariance do not fit the model.

    Examples
    --------
    >>> import echelon as ec, numpy as np
    >>> base = ec.base_parameters(ec.load("examples/panda.yaml"))
    >>> values = base.values(np.tile([2, 0, 0, 2, 0, 2, 0.5, 0, 0, 1.0], 7))
    >>> feasibility(base, values).feasible, feasibility(base, -values).feasible
    (True, False)
    """
    target = checked_values(base, values)
    role, B = roles(base.mechanism), base.B_float()
    with precision():
        exact = exact_base(base)
        witness = _witness(base, role, exact, target, solver)
        if witness is not None:
            hint, numbers = witness
            return Feasibility(True, _proof(role, exact, "a robot"), standard=hint, exact=numbers)
        scales, sizes = _scales(role), sizes_of(base, target)
        found = separator(DualProblem(role, exact, B, target, scales, sizes, solver))
    standard, distance = nearest_physical(base, target, covariance, solver=solver)
    nearest = B @ standard
    if found is None:
        text = "neither a robot with these base parameters nor a proof that there is none was found: they are on the "
        text += f"boundary of what robots can have, to within {distance:.2g} of their size or standard deviation"
        return Feasibility(None, text, nearest=nearest, distance=distance)
    return Feasibility(
        False,
        _proof(role, exact, "a separator"),
        separator=found.values,
        nearest=nearest,
        distance=distance,
        exact=found.exact,
    )


def _witness(
    base: BaseModel, role: Roles, exact: ExactBase, target: Floats, solver: str
) -> tuple[Floats, tuple[Fraction, ...]] | None:
    """Standard parameters of a robot that exact arithmetic confirms, in floats and exactly, or None."""
    try:
        hint = physical_lift(base, target, solver=solver)
    except (InputError, EchelonError):
        return None
    standard = exact.completed([rational_number(x) for x in hint], [rational_number(x) for x in target])
    if not all(standard[c] >= 0 for c in role.positive):
        return None
    for start in role.starts:
        body = standard[start : start + PER_BODY]
        if not is_semidefinite(exact_pseudo_inertia(body), definite=True):
            return None
    return hint, tuple(as_fraction(x) for x in standard) if exact.rational else ()


def _scales(role: Roles) -> Floats:
    """Diagonal factors that give every block of a dual matrix the unit of a mass, shape (b, 4)."""
    length = characteristic_length(role.mechanism)
    return np.tile([length, length, length, 1.0], (len(role.bodies), 1))


def _proof(role: Roles, exact: ExactBase, what: str) -> str:
    arithmetic = "exact rational arithmetic" if exact.rational else "interval arithmetic of 256 bits"
    bodies = f"{len(role.bodies)} pseudo-inertias"
    signs = f" and {len(role.positive)} signs" if role.positive else ""
    if what == "a robot":
        return f"a robot with exactly these base parameters: {bodies}{signs} verified in {arithmetic}"
    return (
        f"a linear function that no robot makes negative and these values do: {bodies}{signs} verified in {arithmetic}"
    )
