"""Words to choose from: settings, their schemas and the command line take them from here.

Nothing is imported, so that ``echelon --help`` is instant.
"""

from __future__ import annotations

from typing import Literal

Order = Literal["base-to-tip", "tip-to-base"]
"""Which parameters become representatives: order of the columns."""
Measured = Literal["drives", "file"]
"""Outputs: forces of all drives, or the sensors of an MJCF file."""
Estimator = Literal["ols", "wls", "irls", "huber", "tls", "ridge", "iv"]
"""Estimators of base parameters."""
Criterion = Literal["bic", "f-test", "relative_std"]
"""Criteria of the elimination of base parameters that the data do not need."""
Values = Literal["estimate", "essential", "physical"]
"""Values that predictions use."""
ValuesToUse = Literal["auto", Values]
"""The same as a set-up states them; ``"auto"`` are those that predict best."""
Optimality = Literal["d_optimal", "a_optimal", "condition"]
"""Criteria of exciting trajectories."""
Family = Literal["fourier", "bspline", "sum"]
"""Functions of time of exciting trajectories."""
Unreadable = Literal["refuse", "boxes", "none"]
"""Handling of shapes of a robot file that cannot be read."""
CalibrationErrors = Literal[
    "frames", "modified_dh", "standard_dh", "offsets", "gears", "stiffness"
]
"""Errors of the geometry that a calibration looks for."""
Form = Literal["auto", "short", "named"]
"""How the entries of a symbolic regressor are written."""
