"""Whether any robot that can exist has given base parameters.

If one has them, it is found: the values of the parameters that are no pivots give pivots with which B ζ = ζ̄ holds, and
plain linear algebra confirms that all pseudo-inertias are positive definite.  If none has them, the nearest robot is
the solution of a convex problem, and its distance tells how far they are off.
"""

from __future__ import annotations

from contextlib import suppress

import numpy.typing as npt

from echelon.base.model import BaseModel
from echelon.errors import EchelonError
from echelon.identification.physics.constraints import roles
from echelon.identification.physics.nearest import checked_values, exact_lift, nearest_physical
from echelon.identification.physics.result import Feasibility

_DISTINCT = 2e-3
"""Distance from which on values are not those of the nearest robot: solvers and margins account for less."""


def feasibility(
    base: BaseModel,
    values: npt.ArrayLike,
    covariance: npt.ArrayLike | None = None,
) -> Feasibility:
    """Whether a robot that can exist has given base parameters.

    Every body that carries all ten parameters needs J ≻ 0; signs of the others are those of
    :mod:`echelon.identification.physics.constraints`.

    Parameters
    ----------
    base : BaseModel
    values : array of shape (r,)
        Base parameters, SI units.
    covariance : array of shape (r, r), optional
        Of the values, for the distance to the nearest robot; without it the distance is relative to the sizes of the
        values.

    Returns
    -------
    Feasibility
        ``feasible`` is None where the values are on the boundary of what robots can have.

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
    target, role = checked_values(base, values), roles(base.mechanism)
    signs = f" and {len(role.positive)} signs" if role.positive else ""
    with suppress(EchelonError):  # where the solver gives up, the distance decides
        lift = exact_lift(base, target)
        if lift is not None:
            text = f"a robot has these base parameters: {len(role.bodies)} pseudo-inertias{signs} were verified"
            return Feasibility(True, text, standard=lift)
    standard, distance = nearest_physical(base, target, covariance)
    away = f"{distance:.2g} {'of their size' if covariance is None else 'standard deviations'}"
    nearest = base.B_float() @ standard
    if distance > _DISTINCT:
        return Feasibility(False, f"the nearest robot is {away} away", nearest=nearest, distance=distance)
    text = f"these base parameters are on the boundary of what robots can have, to within {away}"
    return Feasibility(None, text, nearest=nearest, distance=distance)
