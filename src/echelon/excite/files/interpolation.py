"""The motion through given samples: a spline of degree 5, so that accelerations and jerks are continuous.

The spline goes through all samples, and its knots are sample times but for the two next to each end, which would leave
it undetermined.  Derivatives that come with the samples are not needed; they witness that the samples are dense and
precise enough for the spline to be the motion that was meant.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.families.bsplines import DEGREE, Splines
from echelon.excite.files.samples import FEWEST, Samples
from echelon.excite.trajectory import LARGEST, SHORTEST_STEP, Trajectory

GROSS = 0.2
"""Root mean square of a difference, relative to that of what differs, that cannot come from interpolating."""

_NAMES = ("positions", "velocities", "accelerations")


def interpolated(samples: Samples, units: Sequence[str], source: str, row: str = "row") -> Trajectory:
    """The quintic spline through samples, from time 0 on.

    Parameters
    ----------
    samples : Samples
        At times that rise.
    units : sequence of str
        ``"rad"`` or ``"m"`` of each coordinate.
    source : str
        File name for messages.
    row : str
        What a sample is called in messages.

    Raises
    ------
    InputError
        If there are less than six samples, a number is not finite, times do not rise, or velocities or accelerations
        are not those of the spline by far; names row or column.
    """
    _check_numbers(samples, source, row)
    t = samples.t - samples.t[0]
    _check_times(t, samples.t, source, row)
    spline = make_interp_spline(t, samples.states[0], k=DEGREE)
    # the spline's knots: inside, each once; at the ends, so often that the spline ends there
    breaks = spline.t[DEGREE : len(spline.t) - DEGREE]
    points: Floats = np.ascontiguousarray(spline.c, dtype=float)
    _check_derivatives(samples, BSpline(spline.t, points, DEGREE), t, source)
    return Trajectory(samples.coordinates, tuple(units), Splines(tuple(breaks.tolist())), points)


def _check_numbers(samples: Samples, source: str, row: str) -> None:
    count = len(samples.t)
    if count < FEWEST:
        raise InputError(f"holds {count} samples; a trajectory needs at least {FEWEST}", source=source)
    columns = [("t", samples.t), *((samples.column(order, j), values) for order, j, values in samples.columns())]
    for name, values in columns:
        sound = np.abs(values) <= LARGEST
        if not np.all(sound):
            k = int(np.argmin(sound))
            problem = f"is no finite number up to {LARGEST:.0e}, in SI units"
            raise InputError(f"{values[k]} {problem}", source=source, element=f"column '{name}', {row} {k}")


def _check_times(t: Floats, stated: Floats, source: str, row: str) -> None:
    """Times rise, also after the first one is taken from them."""
    rising = np.diff(t) >= SHORTEST_STEP
    if not np.all(rising):
        k = int(np.argmin(rising))
        problem = f"{stated[k + 1]!s} s follows {stated[k]!s} s; times must rise"
        raise InputError(problem, source=source, element=f"column 't', {row} {k + 1}")


def _check_derivatives(samples: Samples, spline: BSpline, t: Floats, source: str) -> None:
    """Velocities and accelerations that the file states; differences that rounding explains do not count."""
    speeds, step = spline(t, nu=1), float(np.min(np.diff(t)))
    stamps = samples.resolution + float(np.spacing(np.abs(samples.t).max()))
    for order, j, stated in samples.columns():
        if order == 0:
            continue
        found: Floats = spline(t, nu=order)[:, j]
        rounding = 4 * float(np.spacing(np.abs(samples.states[0][:, j]).max())) + stamps * _rms(speeds[:, j])
        difference, scale = _rms(stated - found), max(_rms(stated), _rms(found))
        # of what the steps can show, the fastest oscillation makes the most of an error
        if difference > GROSS * scale + rounding * (np.pi / step) ** order:
            share = f"{100 * difference / scale:.0f} %"
            problem = (
                f"its {_NAMES[order]} are not those of the positions, from which they differ by {share} (rms): "
                "steps are too long, positions have too few digits, or units differ"
            )
            raise InputError(problem, source=source, element=f"column '{samples.column(order, j)}'")


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
