"""Zero-phase low-pass filters: recursive ones that run forwards and then backwards.

Butterworth for signals, because its pass-band is flat, so that amplitudes and with them parameters stay; forwards and
backwards because positions, velocities and torques must keep their common time.  Sections of second order because one
polynomial of order 4 already loses its digits at a cut-off of a thousandth of the rate.  As everywhere in the field a
cut-off is that of one pass (−3 dB), so that both together take 6 dB there.

How far a result depends on its neighbours has a closed form: the response to an impulse is Σ c p^|lag| over the poles
p, with residues c of H(z) H(1/z), and so is its tail.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import isfinite

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError

Complexes = npt.NDArray[np.complex128]

LOWEST = 1e-6
"""Cut-off, relative to the rate, below which a filter would be longer than any log."""

FAR = 1e-9
"""Influence of a sample, as a share of its value, below which a result does not depend on it."""

NEAR = 1e-2
"""Influence of what lies beyond the end of a signal, below which a result is not spoilt by it."""

_ORIGIN = 1e-9
"""Radius within which a pole forgets everything in one sample; exactly zero has no residue of the same form."""


@dataclass(frozen=True, eq=False)
class ZeroPhase:
    """A recursive filter that runs forwards and backwards.

    Attributes
    ----------
    zeros, poles : complex arrays
        Of one pass, in the z-plane.
    gain : float
    """

    zeros: Complexes
    poles: Complexes
    gain: float

    def reach(self, influence: float = FAR) -> int:
        """Samples on either side of a result, beyond which all others together count for less than this.

        Parameters
        ----------
        influence : float
            Share of the largest sample.
        """
        size = np.abs(self.poles)
        weights = np.abs(self._residues()) / (1 - size)
        low, high = 0, 1
        while 2 * float(weights @ size**high) > influence:
            low, high = high, 2 * high
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if 2 * float(weights @ size**middle) > influence else (low, middle)
        return high

    def apply(self, values: Floats, padding: int | None = None, every: int = 1) -> Floats:
        """The filtered values.

        Parameters
        ----------
        values : array of shape (N, …)
            Filtered along the first axis.
        padding : int, optional
            Samples by which a signal is continued at its ends, turned about its end point; scipy's choice if None.
        every : int
            Of how many samples one is kept.
        """
        from scipy.signal import sosfiltfilt, zpk2sos

        sections = zpk2sos(self.zeros, self.poles, self.gain)  # type: ignore[arg-type]  # complex, as they must be
        length = 3 * (2 * len(sections) + 1 - _at_origin(sections)) if padding is None else padding
        length = min(length, len(values) - 1)

        def along_time(rows: Floats) -> Floats:
            found: Floats = sosfiltfilt(sections, rows, axis=-1, padlen=length)
            return found

        return by_channel(along_time, values, every)

    def _residues(self) -> Complexes:
        """Coefficients c of the response Σ c p^|lag| to an impulse."""
        found = np.empty(len(self.poles), complex)
        poles = np.where(np.abs(self.poles) < _ORIGIN, _ORIGIN, self.poles)
        for k, pole in enumerate(poles):
            others = np.delete(poles, k)
            forwards = self.gain * np.prod(pole - self.zeros) / np.prod(pole - others)
            backwards = self.gain * np.prod(1 / pole - self.zeros) / np.prod(1 / pole - poles)
            found[k] = forwards * backwards / pole
        return found


def _at_origin(sections: Floats) -> int:
    """How many sections are of first order, as scipy counts them for the length of its padding."""
    return int(min((sections[:, 2] == 0).sum(), (sections[:, 5] == 0).sum()))


def by_channel(function: Callable[[Floats], Floats], values: Floats, every: int = 1) -> Floats:
    """Apply a function along time to every channel, on all processors.

    Channels are laid along time in memory for it: recursions then read one number after another, and they free the
    interpreter while they run.

    Parameters
    ----------
    function : callable
        From an array of shape (channels, N) to one of the same shape; must not change its argument.
    values : array of shape (N, …)
    every : int
        Of how many rows of the result one is kept.
    """
    values = np.asarray(values, dtype=np.float64)
    table = values.reshape(len(values), -1)
    result = np.empty((-(-len(values) // every), table.shape[1]))
    processors = os.cpu_count() or 1
    group = max(1, min(16, -(-table.shape[1] // processors)))

    def work(first: int) -> None:
        some = slice(first, first + group)
        result[:, some] = function(np.ascontiguousarray(table[:, some].T)).T[::every]

    starts = range(0, table.shape[1], group)
    if values.size < 1 << 17 or len(starts) == 1:
        for start in starts:
            work(start)
    else:
        with ThreadPoolExecutor(processors) as pool:
            list(pool.map(work, starts))
    return result.reshape(len(result), *values.shape[1:])


def butterworth(cutoff: float, rate: float, order: int = 4) -> ZeroPhase:
    """A Butterworth low-pass that runs forwards and backwards.

    Parameters
    ----------
    cutoff : float
        Where one pass takes 3 dB, Hz.
    rate : float
        Samples per second.
    order : int
        Of one pass.

    Raises
    ------
    InputError
        If the cut-off is not between zero and half the rate, or the order not between 1 and 12.
    """
    from scipy.signal import butter

    check_cutoff(cutoff, rate)
    if not 1 <= order <= 12:
        raise InputError(f"order {order} of a Butterworth filter: expected a whole number from 1 to 12")
    zeros, poles, gain = butter(order, cutoff, fs=rate, output="zpk")
    return ZeroPhase(np.asarray(zeros, complex), np.asarray(poles, complex), float(gain))


def chebyshev(edge: float, rate: float) -> ZeroPhase:
    """A Chebyshev low-pass of order 8 with 0.05 dB ripple, forwards and backwards, as programs decimate with.

    Parameters
    ----------
    edge : float
        End of the pass-band, Hz.
    rate : float
        Samples per second.

    Raises
    ------
    InputError
        If the edge is not between zero and half the rate.
    """
    from scipy.signal import cheby1

    check_cutoff(edge, rate)
    zeros, poles, gain = cheby1(8, 0.05, 2 * edge / rate, output="zpk")
    return ZeroPhase(np.asarray(zeros, complex), np.asarray(poles, complex), float(gain))


def lowpass(values: Floats, cutoff: float, rate: float, order: int = 4) -> Floats:
    """Butterworth low-pass without delay.

    At its ends a signal is continued by itself, turned about the end point, for as long as that matters.

    Parameters
    ----------
    values : array of shape (N, …)
        Filtered along the first axis.
    cutoff : float
        Of one pass, Hz; ``inf`` for no filter.
    rate : float
        Samples per second.
    order : int
        Of one pass.

    Raises
    ------
    InputError
        If the cut-off is not between zero and half the rate.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(2000) / 1000
    >>> slow, fast = np.sin(2 * np.pi * 2 * t), np.sin(2 * np.pi * 200 * t)
    >>> float(np.abs(lowpass(slow + fast, cutoff=40, rate=1000) - slow)[100:-100].max()) < 1e-4
    True
    """
    if cutoff == np.inf:
        return np.array(values, dtype=np.float64)
    both = butterworth(cutoff, rate, order)
    return both.apply(values, 2 * both.reach(NEAR))


def check_cutoff(cutoff: float, rate: float) -> None:
    """Refuse a cut-off that no filter at this rate can have.

    Raises
    ------
    InputError
        If the cut-off is not between a millionth of and half the rate.
    """
    if not (isfinite(cutoff) and LOWEST * rate <= cutoff < rate / 2):
        raise InputError(
            f"a cut-off of {cutoff:g} Hz is impossible at {rate:g} samples per second: expected more than "
            f"{LOWEST * rate:g} Hz and less than {rate / 2:g} Hz, or inf for no filter"
        )
