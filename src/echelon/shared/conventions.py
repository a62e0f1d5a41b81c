"""The parameter order, names, units and dimensions.  Every other convention is converted at the border.

The ten standard parameters of a body are taken about the *origin of the body's frame* and along its axes:
the inertia tensor ``XX XY XZ YY YZ ZZ``, the first mass moments ``MX MY MZ`` (mass times centre of mass) and the
mass ``M``.
"""

from __future__ import annotations

from typing import Final

PARAMETERS: Final = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")
"""Names of the standard parameters of one body, in column order."""

PER_BODY: Final = len(PARAMETERS)

LENGTH_DEGREE: Final = (2, 2, 2, 2, 2, 2, 1, 1, 1, 0)
"""Power of length in the unit of each standard parameter: kg·m², kg·m, kg."""

UNITS: Final = ("kg·m²",) * 6 + ("kg·m",) * 3 + ("kg",)
"""SI unit of each standard parameter."""
