"""Signals behind a filter of first order, for regressors without accelerations.

y = X ζ stays true behind any linear filter that all of it passes.  Behind λ/(s + λ) the rate of the momentum needs no
derivative: it is λ times the momentum less its filtered value (Slotine and Li 1989).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from echelon.shared import Floats, InputError, public


@public
def low_pass(
    times: npt.ArrayLike,
    values: npt.ArrayLike,
    bandwidth: float,
    start: npt.ArrayLike = 0.0,
) -> Floats:
    """A signal behind λ/(s + λ), exact where it is linear between samples.

    With h the time to the next sample, e = exp(−λ h) and g = (1 − e)/(λ h), a controller computes
    y[k+1] = e y[k] + (g − e) x[k] + (1 − g) x[k+1].

    Parameters
    ----------
    times : array of shape (N,)
        Increasing, s.
    values : array of shape (N, ...)
        The signal x, in any unit.
    bandwidth : float
        λ, rad/s.
    start : array of shape (...), optional
        First value of the filtered signal, 0 unless given; the last one of a piece continues it in the next.

    Returns
    -------
    array of shape (N, ...)

    Raises
    ------
    InputError
        If times do not increase, shapes do not fit, a number is not finite, or the bandwidth is not positive.

    Examples
    --------
    >>> import echelon as ec
    >>> ec.low_pass([0.0, 0.1, 0.2], [1.0, 1.0, 1.0], 10.0).round(3).tolist()
    [0.0, 0.632, 0.865]
    """
    at, signal = np.asarray(times, dtype=float), np.asarray(values, dtype=float)
    if at.ndim != 1 or signal.shape[:1] != at.shape:
        raise InputError(
            f"times has shape {at.shape} and values {signal.shape}; expected (N,) and (N, ...)"
        )
    steps = np.diff(at)
    first = np.asarray(start, dtype=float)
    if first.shape not in ((), signal.shape[1:]):
        raise InputError(
            f"start has shape {first.shape}; expected {signal.shape[1:]}, as each sample has"
        )
    finite = all(np.isfinite(array).all() for array in (signal, at, first))
    if not (finite and (steps > 0).all()):
        raise InputError("times must increase, and all numbers must be finite")
    if not 0 < bandwidth < np.inf:
        raise InputError(f"bandwidth is {bandwidth}; expected rad/s above zero")
    phases = bandwidth * steps
    kept, means = np.exp(-phases), -np.expm1(-phases) / phases
    found = np.empty_like(signal)
    if len(signal):
        found[0] = first
    for k, (e, g) in enumerate(zip(kept, means, strict=True)):
        found[k + 1] = e * found[k] + (g - e) * signal[k] + (1 - g) * signal[k + 1]
    return found
