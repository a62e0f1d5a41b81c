"""Delays between channels, below one sample, and how they are undone.

The correlation is largest at the whole number of samples that is nearest; from there a few Gauss–Newton steps find the
delay at which one channel is most nearly a multiple of the other, interpolated between its samples.  Signals are
differenced first: slow motion and offsets correlate at any delay.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError

HALF = 32
"""Samples on either side from which a value between samples is interpolated."""

_KAISER = 8.0
"""Shape of the window over the ideal interpolation: errors of 1e-4 up to nine tenths of half the rate."""

_STEPS = 20


@dataclass(frozen=True)
class Delay:
    """How far one channel is behind another.

    Attributes
    ----------
    seconds : float
        Positive if the second channel is late.
    correlation : float
        Of the two after the delay is undone, between −1 and 1.
    """

    seconds: float
    correlation: float


def delay(first: npt.ArrayLike, second: npt.ArrayLike, rate: float, largest: float) -> Delay:
    """How far the second channel is behind the first.

    Parameters
    ----------
    first, second : arrays of shape (N,)
        Proportional to each other but for noise.
    rate : float
        Samples per second.
    largest : float
        Delays up to this are looked for, both ways, s.

    Raises
    ------
    InputError
        If a channel is constant, the channels differ in length, or are not longer than twice the largest delay.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.convolve(np.random.default_rng(0).standard_normal(3000), np.ones(8), "same")
    >>> round(delay(x[10:], x[:-10], rate=1000, largest=0.1).seconds, 6)
    0.01
    """
    a, b = np.diff(np.asarray(first, dtype=float)), np.diff(np.asarray(second, dtype=float))
    most = ceil(largest * rate)
    if len(a) != len(b) or len(a) <= 2 * most + 8:
        raise InputError(f"a delay of up to {largest:g} s needs two channels of more than {2 * most + 8} samples")
    a, b = a - a.mean(), b - b.mean()
    # only the middle of the first is compared, which is within the second at every delay
    middle = a.copy()
    middle[:most] = middle[len(a) - most :] = 0.0
    size = 2 * len(a)
    if not (np.any(middle) and np.any(b)):
        raise InputError("a constant channel has no delay")
    cross = np.conj(np.fft.rfft(middle, size)) * np.fft.rfft(b, size)
    lags = np.arange(-most, most + 1)
    lag = float(lags[int(np.argmax(np.fft.irfft(cross, size)[lags]))])
    inside = slice(most, len(a) - most)
    for _ in range(_STEPS):
        late = shifted(b, lag)
        both = np.column_stack([late, np.gradient(late)])[inside]
        factor, slope = np.linalg.lstsq(both, a[inside], rcond=None)[0]
        step = float(np.clip(slope / factor, -0.5, 0.5)) if factor else 0.0
        lag += step
        if abs(step) < 1e-7:
            break
    late = shifted(b, lag)[inside]
    scale = float(np.linalg.norm(a[inside]) * np.linalg.norm(late))
    return Delay(lag / rate, float(a[inside] @ late) / scale)


def shift_reach(samples: float) -> int:
    """Samples on either side that a shifted signal depends on."""
    return 0 if samples == 0 else ceil(abs(samples)) + HALF


def shifted(values: Floats, samples: float) -> Floats:
    """The signal some samples later: what was late comes back to its time.

    Between samples by band-limited interpolation; at its ends a signal is continued by its last value.

    Parameters
    ----------
    values : array of shape (N, …)
    samples : float
        Any number; whole numbers are exact.

    Returns
    -------
    array of shape (N, …)
        Row k is the signal at k + samples.
    """
    from scipy.ndimage import correlate1d

    values = np.asarray(values, dtype=np.float64)
    whole = floor(samples + 0.5)
    rest = samples - whole
    rows = np.clip(np.arange(len(values)) + whole, 0, len(values) - 1)
    moved = values[rows]
    if abs(rest) < 1e-12:
        return moved
    places = np.arange(-HALF, HALF + 1)
    taps = np.sinc(places - rest) * np.i0(_KAISER * np.sqrt(1 - (places / (HALF + 1)) ** 2))
    found: Floats = correlate1d(moved, taps / taps.sum(), axis=0, mode="nearest")
    return found
